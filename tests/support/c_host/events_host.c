/* Runs the events of the stepper in C on random toy FMUs of FMI 3.0, without Python, so that sanitizers see all of
 * its memory.
 *
 *     events_host FIRST_SEED SEEDS
 *
 * A seed determines the clocks of a toy, the variables that belong to them, its events, and what it does wrong. All
 * tables have exactly their size. The toy checks the mode in which each call comes, its time and its arguments; clocked
 * variables exist while one of their clocks ticks. The host does each step twice from the same state, which must give
 * the same bits, and compares periodic clocks with their closed form. Otherwise it is as stepper_host.c.
 */
#define _POSIX_C_SOURCE 200809L /* sigaction */
#include <math.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "stepper.c"

#define HOST "events_host"
#include "fuzz_basics.h"

#include "events_toy.h"

static const char *const problem_names[] = {
    "NO_PROBLEM",       "CALL_FAILED",   "RUN_ENDED",       "RETURN_REFUSED",  "EVENT_REFUSED",
    "WRONG_TIME",       "NO_EVENT_TIME", "ENDLESS_UPDATES", "ENDLESS_RETURNS", "ENDLESS_TICKS",
    "TICK_WITHIN_STEP", "TICK_ALONE",    "TOO_MANY_TICKS",  "WRONG_INTERVAL",  "WRONG_SHIFT"};
enum { N_PROBLEMS = sizeof problem_names / sizeof problem_names[0] };

static int64_t n_problems[N_PROBLEMS]; /* of the last call of each toy */

static void check_problem(const Toy *toy, int32_t problem) {
    const Events *e = &toy->events;
    REQUIRE(problem == e->problem && problem >= NO_PROBLEM && problem < N_PROBLEMS, "no such problem");
    switch (problem) {
        case NO_PROBLEM: REQUIRE(toy->state.mode == STEP_MODE, "it is not in step mode"); break;
        case CALL_FAILED:
            REQUIRE(e->call >= 0 && e->call <= SETTING_BY_HAND, "no such call");
            REQUIRE(is_bad(e->status), "the status is good");
            occurred[RANGE_ERRORS] += e->status == OUT_OF_RANGE;
            break;
        case ENDLESS_TICKS:
        case TICK_ALONE:
        case TOO_MANY_TICKS:
        case WRONG_INTERVAL:
        case WRONG_SHIFT: REQUIRE(e->clock >= 0 && e->clock < e->n_clocks, "no such clock"); break;
        default: break;
    }
}

/* Compare the ticks of periodic clocks until now with their number. */
static void check_ticks(const Toy *toy) {
    const Events *e = &toy->events;
    for (int32_t k = 0; k < e->n_timed; k++) {
        const Ticks *ticks = &e->schedule[k];
        if (e->timed[k].kind > TOLD) continue;
        const double passed = (toy->state.time - ticks->first) / ticks->interval;
        const double expected = floor(passed + 1e-6) + 1.0;
        REQUIRE(ticks->count == (expected > 0.0 ? expected : 0.0), "the number of periodic ticks is wrong");
        REQUIRE(e->counts[e->timed[k].clock] == ticks->count, "ticks are not counted");
    }
    for (int32_t k = 0; k < e->n_triggered; k++)
        REQUIRE(!(count_missing_ticks(e, &e->triggered[k]) > 0.0), "a triggered clock has not ticked");
    REQUIRE(!has_new_inputs(e) || has_unequal_inputs(toy), "discrete inputs are not passed");
}

/* Do a step twice from the same state. */
static int32_t step_twice(Toy *toy, double time, double length) {
    const size_t size = (size_t)toy->events.n_memory * sizeof(double);
    double *before = allocate(1, size), *after = allocate(1, size);
    const State state = toy->state;
    memcpy(before, toy->events.memory, size);
    const int32_t first = events_step(&toy->activity, &toy->events, time, length, 0);
    const State reached = toy->state;
    memcpy(after, toy->events.memory, size);
    toy->state = state;
    memcpy(toy->events.memory, before, size);
    const int32_t again = events_step(&toy->activity, &toy->events, time, length, 0);
    REQUIRE(first == again, "a repeated step ends otherwise");
    REQUIRE(memcmp(after, toy->events.memory, size) == 0, "a repeated step has another memory");
    REQUIRE(reached.dice.state == toy->state.dice.state && reached.n_calls == toy->state.n_calls,
            "a repeated step has other calls");
    free(before);
    free(after);
    return again;
}

static int32_t run_toy(Toy *toy) {
    Events *e = &toy->events;
    const double start = between(&toy->ways, 0, 1) * 3.0, step = toy->step;
    toy->state.time = start;
    int32_t problem = events_start(&toy->activity, e, start);
    check_start(toy, problem);
    if (problem != NO_PROBLEM) return problem;
    toy->state.mode = EVENT_MODE;
    for (int32_t k = 0; k < e->n_discrete; k++) e->passed[k] = e->inputs[e->discrete[k]];
    problem = e->has_event_mode ? events_leave(&toy->activity, e) : NO_PROBLEM;
    if (!e->has_event_mode) toy->state.mode = STEP_MODE;
    check_problem(toy, problem);
    for (int32_t n = 0; n < 20 && problem == NO_PROBLEM; n++) {
        change_inputs(toy);
        problem = step_twice(toy, start + n * step, start + (n + 1) * step - (start + n * step));
        check_problem(toy, problem);
        if (problem == NO_PROBLEM) check_ticks(toy);
        if (problem == NO_PROBLEM && e->has_event_mode && happens(&toy->ways, 0.1)) {
            problem = events_enter(&toy->activity, e);
            if (problem == NO_PROBLEM) problem = events_leave(&toy->activity, e);
            check_problem(toy, problem);
        }
    }
    return problem;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fputs("Usage: events_host FIRST_SEED SEEDS\n", stderr);
        return 2;
    }
    const uint64_t first = strtoull(argv[1], NULL, 10), count = strtoull(argv[2], NULL, 10);
    watch_for_death();
    for (uint64_t seed = first; seed < first + count; seed++) {
        present_seed = seed;
        Toy *toy = build_toy(seed);
        n_problems[run_toy(toy)]++;
        free_toy(toy);
    }
    for (int n = 0; n < N_PROBLEMS; n++) printf("%s %lld ", problem_names[n], (long long)n_problems[n]);
    printf("\n");
    for (int n = 0; n < N_EVENT_OCCURRENCES; n++) printf("%s %lld ", occurrence_names[n], (long long)occurred[n]);
    printf("\n");
    return 0;
}
