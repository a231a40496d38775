/* Threads that share each step of a program. Exported FMUs do not have this file.
 *
 * Each thread has a lane: some operations of the program, in their order. An operation waits until other lanes have
 * done what it needs. All lanes meet at the end of a step, so that rows and failures are those of one thread. The
 * first lane is the thread that calls `lanes_run`. The others last until `lanes_end`: they sleep between two runs,
 * and within a run they spin for a moment, and then let other threads run.
 *
 * Each lane has its own copy of the record `Stepper`. The tables and vectors behind its pointers are shared. What
 * came out is its own, as is its `Activity`.
 *
 * The atomic functions are those of gcc and clang, as this is always compiled by zig, which is clang.
 */
#include <stdlib.h>

#include "system.h"

enum {
    SPINS = 200,      /* checks before a thread lets others run: about ten microseconds */
    DISTANCE = 128,   /* bytes between what two threads write, so that they do not share a line of a cache */
    NOWHERE = INT32_MAX
};

/* Wait until another lane has done so many of its tasks of the step. */
typedef struct {
    int32_t lane, tasks;
} Wait;

typedef struct {
    const Wait *waits;
    int32_t n_waits;
    int32_t operation; /* its place in the program */
} Task;

typedef struct {
    const Task *tasks;
    Activity *activity;
    int64_t n_tasks;
} LanePlan;

STEPPER_API extern const size_t lanes_sizes[]; /* of these three records */
const size_t lanes_sizes[] = {sizeof(Wait), sizeof(Task), sizeof(LanePlan)};

typedef struct Lanes Lanes;

typedef struct {
    int64_t done; /* tasks so far, and the end of each step; other lanes read it */
    char apart[DISTANCE];
    Lanes *all;
    Stepper *stepper; /* the copy, or for the first lane the record of the caller */
    Stepper copy;
    LanePlan plan;
    Thread *thread;
    int32_t failed, failure; /* the first of its operations that failed in this step, and how */
    Stepper blamed;          /* the record after it */
    char end[DISTANCE];
} Lane;

struct Lanes {
    Lane *lanes;
    Gate *gate; /* open while steps are done */
    int32_t n_lanes;
    int64_t k; /* the step, and its time and length, for all lanes */
    double time, length;
    char apart[DISTANCE];
    int64_t begun;  /* steps since `lanes_start` */
    int32_t failed; /* the first operation that failed */
    int32_t is_ending;
    char end[DISTANCE];
};

STEPPER_API Lanes *lanes_start(Stepper *stepper, const LanePlan *plans, int32_t n_lanes);
STEPPER_API int32_t lanes_run(Lanes *all, int64_t first, int64_t count, int64_t every, double *rows);
STEPPER_API void lanes_end(Lanes *all);

/* Tell the processor that this thread waits. */
static void relax(void) {
#if defined __x86_64__
    __builtin_ia32_pause();
#elif defined __aarch64__
    __asm__ volatile("yield");
#endif
}

static int64_t read_counter(const int64_t *counter) { return __atomic_load_n(counter, __ATOMIC_ACQUIRE); }

static void set_counter(int64_t *counter, int64_t value) { __atomic_store_n(counter, value, __ATOMIC_RELEASE); }

/* Wait until another thread has raised a counter. */
static void await(const int64_t *counter, int64_t least) {
    for (int32_t tries = 0; read_counter(counter) < least; tries++) {
        if (tries < SPINS) {
            relax();
        } else {
            tries = SPINS;
            thread_yield();
        }
    }
}

/* What the counter of a lane was at the begin of a step. */
static int64_t count_before(const Lane *lane, int64_t step) { return (step - 1) * (lane->plan.n_tasks + 1); }

/* Note a failure. The first by the order of the program counts, whatever lane comes to it first. */
static void note_failure(Lane *lane, int32_t operation, int32_t failure) {
    int32_t *first = &lane->all->failed, earliest = __atomic_load_n(first, __ATOMIC_RELAXED);
    while (operation < earliest &&
           !__atomic_compare_exchange_n(first, &earliest, operation, 0, __ATOMIC_ACQ_REL, __ATOMIC_RELAXED)) {
    }
    if (operation > lane->failed) return;
    lane->failed = operation;
    lane->failure = failure;
    lane->blamed = *lane->stepper; /* earlier operations follow, whose discarded steps replace what it says */
}

/* Do a task after those that it needs. After a failure only earlier operations are done. */
static void do_task(Lane *lane, const Task *task, int64_t step) {
    Lanes *all = lane->all;
    Stepper *s = lane->stepper;
    for (int32_t w = 0; w < task->n_waits; w++) {
        const Lane *other = &all->lanes[task->waits[w].lane];
        await(&other->done, count_before(other, step) + task->waits[w].tasks);
    }
    if (__atomic_load_n(&all->failed, __ATOMIC_ACQUIRE) < task->operation) return;
    const int32_t failure = operate(s, &s->operations[task->operation], all->k, all->time, all->length);
    if (failure != DONE) note_failure(lane, task->operation, failure);
}

static void do_tasks(Lane *lane, int64_t step) {
    const int64_t before = count_before(lane, step), n = lane->plan.n_tasks;
    for (int64_t t = 0; t < n; t++) {
        do_task(lane, &lane->plan.tasks[t], step);
        set_counter(&lane->done, before + t + 1);
    }
    announce(lane->stepper, 0);
    set_counter(&lane->done, before + n + 1);
}

/* Wait for a step; returns 0 if there will be none. */
static int await_step(Lanes *all, int64_t step) {
    for (int32_t tries = 0; read_counter(&all->begun) < step; tries++) {
        if (tries < SPINS) {
            relax();
            continue;
        }
        tries = SPINS;
        gate_pass(all->gate);
        if (__atomic_load_n(&all->is_ending, __ATOMIC_ACQUIRE)) return 0;
        thread_yield();
    }
    return 1;
}

static void work_in_lane(void *argument) {
    Lane *lane = argument;
    for (int64_t step = 1; await_step(lane->all, step); step++) do_tasks(lane, step);
}

/* Return the failure of a step that all lanes have ended, and copy what the failed one says of it. */
static int32_t judge(const Lanes *all, Stepper *s) {
    for (int32_t n = 0; n < all->n_lanes; n++) {
        const Lane *lane = &all->lanes[n];
        if (all->failed == NOWHERE || lane->failed != all->failed) continue;
        s->instance = lane->blamed.instance;
        s->status = lane->blamed.status;
        s->time = lane->blamed.time;
        s->length = lane->blamed.length;
        s->group = lane->blamed.group;
        s->group_sweeps = lane->blamed.group_sweeps;
        return lane->failure;
    }
    return are_finite(s) ? DONE : NOT_FINITE;
}

static int32_t step_together(void *worker, int64_t k, double time, double length) {
    Lanes *all = worker;
    Stepper *s = all->lanes[0].stepper;
    const int64_t step = all->begun + 1;
    if (s->n_groups > 0) see(s);
    all->k = k;
    all->time = time;
    all->length = length;
    set_counter(&all->begun, step);
    do_tasks(&all->lanes[0], step);
    for (int32_t n = 1; n < all->n_lanes; n++) await(&all->lanes[n].done, count_before(&all->lanes[n], step + 1));
    return judge(all, s);
}

/* Do steps as `stepper_run` does. */
int32_t lanes_run(Lanes *all, int64_t first, int64_t count, int64_t every, double *rows) {
    Stepper *s = all->lanes[0].stepper;
    all->failed = NOWHERE;
    for (int32_t n = 0; n < all->n_lanes; n++) {
        Lane *lane = &all->lanes[n];
        lane->failed = NOWHERE;
        lane->copy = *s;
        lane->copy.activity = lane->plan.activity;
        lane->copy.sweeps_done = 0;
    }
    gate_open(all->gate);
    const int32_t failure = run_steps(s, step_together, all, first, count, every, rows);
    gate_close(all->gate);
    for (int32_t n = 1; n < all->n_lanes; n++) s->sweeps_done += all->lanes[n].copy.sweeps_done;
    return failure;
}

/* Start a thread for each lane but the first. The lanes use the record and the plans until `lanes_end`.
 * Returns NULL if the system provides too few threads. */
Lanes *lanes_start(Stepper *stepper, const LanePlan *plans, int32_t n_lanes) {
    Lanes *all = calloc(1, sizeof *all);
    if (all == NULL) return NULL;
    all->lanes = calloc((size_t)n_lanes, sizeof(Lane));
    all->gate = gate_create();
    int is_complete = all->lanes != NULL && all->gate != NULL;
    for (int32_t n = 0; is_complete && n < n_lanes; n++) {
        Lane *lane = &all->lanes[all->n_lanes++];
        lane->all = all;
        lane->plan = plans[n];
        lane->stepper = n == 0 ? stepper : &lane->copy;
    }
    for (int32_t n = 1; is_complete && n < n_lanes; n++)
        is_complete = (all->lanes[n].thread = thread_start(work_in_lane, &all->lanes[n])) != NULL;
    if (is_complete) return all;
    lanes_end(all);
    return NULL;
}

/* End the threads, and free everything. */
void lanes_end(Lanes *all) {
    __atomic_store_n(&all->is_ending, 1, __ATOMIC_RELEASE);
    if (all->gate != NULL) gate_open(all->gate);
    for (int32_t n = 1; n < all->n_lanes; n++)
        if (all->lanes[n].thread != NULL) thread_join(all->lanes[n].thread);
    if (all->gate != NULL) gate_free(all->gate);
    free(all->lanes);
    free(all);
}
