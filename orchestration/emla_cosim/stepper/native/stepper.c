/* The stepping loop; see stepper.h. */
#include "step.h"

#include "event_calls.h"

#include <time.h>

/* Sizes of the records, for those who fill them in another language. */
const size_t stepper_sizes[] = {sizeof(Call), sizeof(FmuInstance), sizeof(Input), sizeof(Signal), sizeof(Operation),
                                sizeof(Combination), sizeof(Term), sizeof(Group), sizeof(Stepper),
                                sizeof(Controlled), sizeof(Control), sizeof(SavedState), sizeof(Effort),
                                sizeof(Division)};

/* Count a complete row: after its numbers, as the process can be killed at any instruction. */
static void count_row(Activity *activity) {
    if (activity == NULL) return;
#if defined __GNUC__
    __atomic_store_n(&activity->rows, activity->rows + 1, __ATOMIC_RELEASE);
#else
    activity->rows++;
#endif
}

/* Fill the next row. */
static int32_t record(Stepper *s, double time, double *rows) {
    double *row = rows + s->recorded * (1 + s->n_signals + s->n_observed);
    for (int32_t o = 0; o < s->n_observers; o++) {
        const Call *observer = &s->observers[o];
        Effort *effort = s->instances[observer->instance].effort;
        const int64_t start = start_clock(effort);
        const int32_t status = get_values(s, observer, 1, s->observed);
        stop_clock(effort, RECORDING_CALLS, start);
        if (is_bad(status)) return fail(s, OBSERVE_FAILED, observer->instance, status);
    }
    announce(s, 0);
    row[0] = time;
    memcpy(row + 1, s->stores[SIGNALS], (size_t)s->n_signals * sizeof(double));
    if (s->n_observed > 0) memcpy(row + 1 + s->n_signals, s->observed, (size_t)s->n_observed * sizeof(double));
    s->recorded++;
    count_row(s->activity);
    return DONE;
}

/* Does step k, from `time` of this length; returns why it failed, or DONE. */
typedef int32_t Work(void *worker, int64_t k, double time, double length);

ALWAYS_INLINE static int32_t run_steps(Stepper *s, Work *work, void *worker, int64_t first, int64_t count, int64_t every,
                               double *rows) {
    const time_t second = time(NULL);
    double next = point(s, first);
    int64_t until_row = every - first % every; /* steps to the next row: a division takes as long as a call */
    s->reached = first;
    s->recorded = 0;
    s->sweeps_done = 0;
    s->status = fmi2OK;
    s->failure = DONE;
    for (int64_t k = first; k < first + count; k++) {
        const double now = next;
        s->reached = k;
        next = point(s, k + 1);
        s->failure = work(worker, k, now, next - now);
        if (s->failure != DONE) return s->failure;
        s->reached = k + 1;
        if (--until_row == 0) {
            until_row = every;
            s->failure = record(s, next, rows);
            if (s->failure != DONE) return s->failure;
        }
        if (s->stop != NULL && *s->stop) return s->failure = INTERRUPTED;
        if (time(NULL) != second) return s->failure = LATE;
    }
    return DONE;
}

static int32_t step_alone(void *stepper, int64_t k, double time, double length) {
    return step(stepper, k, time, length);
}

int32_t stepper_run(Stepper *s, int64_t first, int64_t count, int64_t every, double *rows) {
    return run_steps(s, step_alone, s, first, count, every, rows);
}

#include "control.h"
