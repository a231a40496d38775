/* Runs the stepper in C on random systems of toy FMUs, without Python, so that sanitizers see all of its memory.
 *
 *     stepper_host FIRST_SEED SEEDS
 *
 * A seed determines a system of up to eight instances of both versions of FMI, its program, and which FMI calls
 * fail. All tables have exactly their size. The toys check the arguments of each call; the host checks what each
 * run leaves. It does a system four times:
 *
 *   - twice in the same way, which must give the same bits,
 *   - in parts of random lengths, which must give the same bits as well, and fail in the same step,
 *   - with one call per step, if nothing fails.
 *
 * stepper_trials.h does the same with another system of this seed under error control.
 *
 * After a failure it does a few more steps: what they compute is undefined, but they must not harm memory. A
 * violation or a report of a sanitizer ends the process with a message that has the seed. Otherwise the exit code
 * is 0, and stdout has two lines of names and numbers: how often a run ended in each way, and what else occurred.
 */
#define _POSIX_C_SOURCE 200809L /* sigaction */
#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

/* The wall time of the stepper is random as well, so that runs end LATE in the same steps each time. */
static time_t read_wall_clock(time_t *result);
#define time(result) read_wall_clock(result)
#include "stepper.c"
#undef time

#define HOST "stepper_host"
#include "fuzz_basics.h"

#include "stepper_toys.h"

#include "stepper_systems.h"

/* ---- what each run must leave ---------------------------------------------------------- */

static const char *const failure_names[] = {
    "DONE",        "SET_FAILED",     "DERIVATIVES_FAILED", "STEP_FAILED",    "GET_FAILED", "NOT_FINITE",
    "SAVE_FAILED", "RESTORE_FAILED", "NO_AGREEMENT",       "OBSERVE_FAILED", "LATE",       "INTERRUPTED",
    "TOO_SHORT"};
enum { N_FAILURES = sizeof failure_names / sizeof failure_names[0] };

static int64_t n_failures[N_FAILURES]; /* of the first way to do each system */

static int can_go_on(int32_t failure) { return failure == DONE || failure == LATE || failure == INTERRUPTED; }

static double time_of_point(const Stepper *s, int64_t k) {
    return (s->clock.first + (double)k * s->clock.per_step) / s->clock.denominator;
}

static size_t width_of(const Stepper *s) { return 1 + (size_t)s->n_signals + (size_t)s->n_observed; }

/* What stands in the record about a failed call must be what a toy of this instance answered. */
static void check_failed_call(const System *system) {
    const Stepper *s = &system->stepper;
    REQUIRE(s->instance >= 0 && s->instance < system->n_instances, "no such instance failed");
    const Toy *toy = &system->toys[s->instance];
    if (s->status == OUT_OF_RANGE) {
        REQUIRE(s->failure == SET_FAILED, "only a value that is set can be out of range");
        occurred[VALUES_OUT_OF_RANGE]++;
    } else {
        REQUIRE(toy->bad_answers & bit_of(s->status), "the instance did not answer so");
    }
    if (s->failure == STEP_FAILED)
        REQUIRE(s->time == toy->step_time && s->length == toy->step_length, "not the step that failed");
}

static void check_failure(const System *system) {
    const Stepper *s = &system->stepper;
    const double *now = s->stores[SIGNALS];
    int n_infinite = 0;
    for (int32_t r = 0; r < s->n_read; r++) n_infinite += !isfinite(now[s->read[r]]);
    switch (s->failure) {
        case DONE: break;
        case LATE: REQUIRE(system->n_ticks > 0, "the second did not pass"); break;
        case INTERRUPTED: REQUIRE(s->stop != NULL && *s->stop, "the flag is not set"); break;
        case NOT_FINITE: REQUIRE(n_infinite > 0, "all signals are finite"); break;
        case NO_AGREEMENT:
            REQUIRE(s->group >= 0 && s->group < s->n_groups, "no such group failed");
            REQUIRE(s->groups[s->group].is_saved, "the group does not repeat steps");
            REQUIRE(s->group_sweeps > 0 && s->group_sweeps <= s->sweeps, "the number of sweeps is wrong");
            REQUIRE(s->length > 0.0 && s->length <= 1.001 * system->step, "the length is wrong");
            break;
        default: check_failed_call(system);
    }
    if (can_go_on(s->failure)) {
        REQUIRE(n_infinite == 0, "signals are not finite");
        REQUIRE(s->activity == NULL || s->activity->code == 0, "an instance is still busy");
    }
    if (s->failure == NOT_FINITE || s->failure == NO_AGREEMENT || can_go_on(s->failure))
        REQUIRE(!system->must_fail || system->is_lost, "the failure of a call is lost");
}

/* Rows begin with the time, and the last one ends with what the toys answered last. */
static void check_rows(const System *system, int64_t first, const double *rows) {
    const Stepper *s = &system->stepper;
    const size_t width = width_of(s);
    for (int64_t r = 0; r < s->recorded; r++) {
        const int64_t k = (first / system->every + 1 + r) * system->every;
        REQUIRE(rows[(size_t)r * width] == time_of_point(s, k), "the time of a row is wrong");
    }
    if (s->recorded == 0 || s->reached % system->every != 0 || s->failure == OBSERVE_FAILED) return;
    if (!can_go_on(s->failure)) return;
    const double *row = rows + (size_t)(s->recorded - 1) * width, *observed = row + 1 + s->n_signals;
    REQUIRE(memcmp(row + 1, s->stores[SIGNALS], (size_t)s->n_signals * sizeof *row) == 0, "wrong signals in a row");
    for (int32_t o = 0; o < s->n_observers; o++) {
        const Call *call = &s->observers[o];
        for (int32_t k = 0; k < call->n_items; k++) {
            const double value = take_number(call->values, call->type, call->places[k]);
            REQUIRE(is_same(observed[call->items[k]], value), "wrong observed variables in a row");
        }
    }
}

/* Check what a call of stepper_run left; `rows` has room for exactly what it can record. */
static void check_run(const System *system, int32_t failure, int64_t first, int64_t count, const double *rows) {
    const Stepper *s = &system->stepper;
    const int64_t is_unobserved = s->failure == OBSERVE_FAILED, every = system->every;
    const size_t filled = (size_t)s->recorded * width_of(s);
    const size_t room = (size_t)((first + count) / every - first / every) * width_of(s);
    REQUIRE(failure == s->failure && failure >= DONE && failure < N_FAILURES, "no such failure");
    REQUIRE(s->reached >= first && s->reached <= first + count, "steps are done that nobody asked for");
    REQUIRE(failure != DONE || s->reached == first + count, "not all steps are done");
    REQUIRE(failure != DONE || s->status == fmi2OK, "a step that was done in halves leaves its status");
    REQUIRE(s->recorded == s->reached / every - first / every - is_unobserved, "the number of rows is wrong");
    REQUIRE(s->activity == NULL || s->activity->rows == s->recorded, "wrong activity");
    for (size_t v = filled; v < room; v++)
        REQUIRE(is_unused(rows[v]), "more rows are written than recorded");
    check_rows(system, first, rows);
    check_failure(system);
}

/* ---- ways to do the steps of a system -------------------------------------------------- */

enum { WHOLE, IN_PARTS };

/* What must not depend on the way. */
typedef struct {
    double *rows, *vectors;
    int64_t recorded, reached, sweeps;
    size_t n_row_values, n_vector_values;
    int32_t failure, instance, status, group, has_faults;
} Outcome;

static void copy_vectors(Outcome *outcome, const System *system) {
    const Stepper *s = &system->stepper;
    const size_t n = (size_t)s->n_signals;
    outcome->n_vector_values = n * (size_t)system->n_stores;
    outcome->vectors = allocate(outcome->n_vector_values, sizeof(double));
    for (int32_t v = 0; v < system->n_stores; v++)
        memcpy(outcome->vectors + (size_t)v * n, s->stores[v], n * sizeof(double));
}

/* Call stepper_run once with room for exactly the rows that it can fill, and add them to `all`. */
static int32_t run_part(System *system, int64_t first, int64_t count, Outcome *all) {
    Stepper *s = &system->stepper;
    const int64_t n_rows = (first + count) / system->every - first / system->every;
    double *rows = allocate((size_t)n_rows * width_of(s), sizeof(double));
    if (s->activity != NULL) s->activity->rows = 0;
    const int32_t failure = stepper_run(s, first, count, system->every, rows);
    if (count > 0) check_run(system, failure, first, count, rows);
    else REQUIRE(failure == DONE && s->recorded == 0 && s->reached == first, "a run of no steps does something");
    const size_t filled = (size_t)s->recorded * width_of(s);
    if (all != NULL) {
        memcpy(all->rows + all->n_row_values, rows, filled * sizeof(double));
        all->n_row_values += filled;
        all->recorded += s->recorded;
        all->sweeps += s->sweeps_done;
    }
    free(rows);
    return failure;
}

/* Do further steps after a failure. Times and values are anything now, so that the toys do not check them. */
static void run_on(System *system) {
    system->is_lost = 1;
    for (int part = 0; part < 4; part++) {
        const int64_t first = system->stepper.reached + 1;
        run_part(system, first, between(&system->ways, 1, 6), NULL);
        if (system->stop != NULL) *system->stop = 0;
    }
}

static Outcome run(uint64_t seed, int way) {
    System *system = build_system(seed, 0);
    Stepper *s = &system->stepper;
    const int64_t end = system->first + system->count;
    const size_t n_rows = (size_t)(end / system->every - system->first / system->every);
    Outcome outcome = {.rows = allocate(n_rows * width_of(s), sizeof(double)), .has_faults = system->n_faults > 0};
    int64_t k = system->first;
    outcome.failure = DONE;
    while (k < end) {
        const int64_t left = end - k;
        const int64_t count = way == WHOLE ? left : between(&system->ways, 0, (int32_t)(left < 12 ? left : 12));
        const int32_t failure = run_part(system, k, count, &outcome);
        if (count > 0) k = s->reached;
        if (failure == LATE || failure == INTERRUPTED) {
            if (way == WHOLE) n_failures[failure]++;
            if (system->stop != NULL) *system->stop = 0;
        } else if (failure != DONE) {
            outcome.failure = failure;
            break;
        }
    }
    outcome.reached = k;
    outcome.instance = s->instance, outcome.status = s->status, outcome.group = s->group;
    copy_vectors(&outcome, system);
    if (outcome.failure != DONE) run_on(system);
    if (outcome.failure == DONE && system->has_halves) occurred[HALVES_THAT_HELPED]++;
    free_system(system);
    return outcome;
}

static void compare_outcomes(const Outcome *a, const Outcome *b) {
    REQUIRE(a->failure == b->failure && a->reached == b->reached, "a repeated run ends elsewhere");
    REQUIRE(a->recorded == b->recorded && a->sweeps == b->sweeps, "a repeated run has other numbers");
    if (a->failure != DONE && a->failure != NOT_FINITE && a->failure != TOO_SHORT)
        REQUIRE(a->failure == NO_AGREEMENT ? a->group == b->group
                                           : a->instance == b->instance && a->status == b->status,
                "a repeated run blames another instance");
    REQUIRE(memcmp(a->rows, b->rows, a->n_row_values * sizeof(double)) == 0, "a repeated run has other rows");
    REQUIRE(memcmp(a->vectors, b->vectors, a->n_vector_values * sizeof(double)) == 0,
            "a repeated run has other vectors");
}

#include "stepper_trials.h"

/* Do all steps with a call for each. */
static void run_by_steps(uint64_t seed, const Outcome *expected) {
    System *system = build_system(seed, 0);
    Outcome outcome;
    for (int64_t k = system->first; k < system->first + system->count; k++)
        REQUIRE(stepper_step(&system->stepper, k) == DONE && system->stepper.failure == DONE, "a step fails alone");
    copy_vectors(&outcome, system);
    REQUIRE(memcmp(outcome.vectors, expected->vectors, expected->n_vector_values * sizeof(double)) == 0,
            "single steps have other results");
    free(outcome.vectors);
    free_system(system);
}

static void run_seed(uint64_t seed) {
    Outcome first = run(seed, WHOLE), again = run(seed, WHOLE), parts = run(seed, IN_PARTS);
    n_failures[first.failure]++;
    compare_outcomes(&first, &again);
    compare_outcomes(&first, &parts);
    if (first.failure == DONE && !first.has_faults) run_by_steps(seed, &first);
    free_outcome(&first);
    free_outcome(&again);
    free_outcome(&parts);
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fputs("Usage: stepper_host FIRST_SEED SEEDS\n", stderr);
        return 2;
    }
    const uint64_t first = strtoull(argv[1], NULL, 10), count = strtoull(argv[2], NULL, 10);
    watch_for_death();
    for (uint64_t seed = first; seed < first + count; seed++) {
        present_seed = seed;
        run_seed(seed);
        control_seed(seed);
    }
    for (int f = 0; f < N_FAILURES; f++) printf("%s %lld ", failure_names[f], (long long)n_failures[f]);
    printf("\n");
    for (int n = 0; n < N_OCCURRENCES; n++) printf("%s %lld ", occurrence_names[n], (long long)occurred[n]);
    printf("\n");
    return 0;
}
