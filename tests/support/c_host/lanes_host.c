/* Shares random systems of toy FMUs among threads, without Python, so that a sanitizer sees every race.
 *
 *     lanes_host FIRST_SEED SEEDS
 *
 * A seed determines a system of up to eight instances, its program, which calls fail, and several ways to share the
 * program among lanes. Each way must give the rows, the failure, and the number of sweeps and calls of one thread.
 * The steps are done in parts, some by one thread, so that lanes also sleep and wake up. The exit code is 0 if all
 * is well, and stdout has a line of names and numbers: how often what the tests are about has occurred.
 */
#define _POSIX_C_SOURCE 200809L /* sigaction, uselocale */
#include <fenv.h>
#include <locale.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stepper.c"

#include "lanes.c"

#include "effort.c"

#define HOST "lanes_host"
#include "fuzz_basics.h"

enum { MOST_INSTANCES = 8, MOST_INPUTS = 3, N_OUTPUTS = 2, N_STEPS = 24, MOST_SWEEPS = 8, N_WAYS = 4 };
enum { MOST_SIGNALS = MOST_INSTANCES * N_OUTPUTS, MOST_LANES = 5, MOST_ROWS = 3 * MOST_INSTANCES };
enum { FAIR, FAILS, DISCARDS_LONG, GIVES_NAN, STOPS };

enum { FAILURES, HALVES, DISAGREEMENTS, INTERRUPTIONS, N_OCCURRENCES };
static const char *const occurrence_names[] = {"failures", "halves", "disagreements", "interruptions"};
static int64_t occurred[N_OCCURRENCES];

static const locale_t no_locale;
static locale_t host_locale;

/* ---- toys ------------------------------------------------------------------------------ */

typedef struct {
    double x, inputs[MOST_INPUTS];
} State;

typedef struct {
    State state, saved;
    double decay, gain, feedthrough;
    int32_t effect, n_halves, rounding;
    int64_t n_steps, first_bad; /* steps, and the first with the effect */
    int32_t *stop;
} Toy;

static fmi2Status set_toy(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[]) {
    (void)r;
    memcpy(((Toy *)c)->state.inputs, values, n * sizeof *values);
    return fmi2OK;
}

static fmi2Status get_toy(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real values[]) {
    const Toy *toy = c;
    const double fed = toy->feedthrough * (toy->state.inputs[0] + toy->state.inputs[1]);
    for (size_t k = 0; k < n; k++) values[k] = (double)(r[k] + 1) * toy->state.x + fed;
    if (toy->effect == GIVES_NAN && toy->n_steps > toy->first_bad) values[0] = NAN;
    return fmi2OK;
}

static fmi2Status do_step_of_toy(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean no_way_back) {
    Toy *toy = c;
    (void)no_way_back;
    REQUIRE(fegetround() == toy->rounding, "a lane has another floating-point environment");
    REQUIRE(uselocale(no_locale) == host_locale, "a lane has another locale");
    const int is_bad_step = ++toy->n_steps > toy->first_bad;
    if (toy->effect == STOPS && toy->n_steps == toy->first_bad) __atomic_store_n(toy->stop, 1, __ATOMIC_RELAXED);
    if (toy->effect == FAILS && is_bad_step) return fmi2Error;
    if (toy->effect == DISCARDS_LONG && is_bad_step && length > 0.06) return fmi2Discard;
    toy->n_halves += length < 0.06;
    double sum = sin(time);
    for (int k = 0; k < MOST_INPUTS; k++) sum += toy->state.inputs[k];
    for (int64_t n = toy->n_steps % 7 * 40; n > 0; n--) sum += 1e-9 * sum; /* steps of different lengths */
    toy->state.x = toy->decay * toy->state.x + length * toy->gain * sum;
    return fmi2OK;
}

static fmi2Status save_toy(fmi2Component c, fmi2FMUstate *state) {
    Toy *toy = c;
    toy->saved = toy->state;
    *state = &toy->saved;
    return fmi2OK;
}

static fmi2Status restore_toy(fmi2Component c, fmi2FMUstate state) {
    Toy *toy = c;
    REQUIRE(state == &toy->saved, "the state is another one");
    toy->state = toy->saved;
    return fmi2OK;
}

/* ---- systems --------------------------------------------------------------------------- */

typedef struct {
    Stepper stepper;
    Toy toys[MOST_INSTANCES];
    FmuInstance instances[MOST_INSTANCES];
    Effort efforts[MOST_INSTANCES];
    Call calls[2 * MOST_INSTANCES];
    Input inputs[MOST_INSTANCES * MOST_INPUTS];
    Signal signals[MOST_SIGNALS];
    Operation operations[MOST_ROWS], of_groups[2][6];
    Group groups[2];
    int32_t members[2][2], coupling[2][2];
    double jacobian[2][4], memory[2][5][4], residuals[2][2 * MOST_SWEEPS], answers[2][2 * MOST_SWEEPS];
    double kept[2][2 * (2 * N_OUTPUTS + 2)];
    double now[MOST_SIGNALS], previous[MOST_SIGNALS], largest[MOST_SIGNALS];
    double input_values[MOST_INSTANCES * MOST_INPUTS], derivatives[MOST_INSTANCES * MOST_INPUTS];
    double taken[MOST_INSTANCES * MOST_INPUTS], taken_at[MOST_INSTANCES * MOST_INPUTS];
    double at[MOST_INSTANCES], before[MOST_INSTANCES];
    double *stores[2];
    int32_t follows[MOST_INSTANCES];
    SavedState states[MOST_INSTANCES];
    int32_t read[MOST_SIGNALS];
    Activity activities[MOST_LANES];
    int32_t stop, n_instances, every[MOST_INSTANCES];
} System;

static const fmi2ValueReference references[MOST_INPUTS] = {0, 1, 2};

static void build_instance(System *system, int32_t i, Dice *dice) {
    FmuInstance *instance = &system->instances[i];
    Toy *toy = &system->toys[i];
    const int32_t first_input = MOST_INPUTS * i, first_output = N_OUTPUTS * i;
    *toy = (Toy){.state = {.x = uniform(dice, -1.0, 1.0)},
                 .decay = uniform(dice, 0.0, 0.9),
                 .gain = uniform(dice, -1.0, 1.0),
                 .feedthrough = uniform(dice, -0.4, 0.4),
                 .rounding = fegetround(),
                 .effect = happens(dice, 0.75) ? FAIR : between(dice, FAILS, STOPS),
                 .first_bad = happens(dice, 0.5) ? 9 : between(dice, 1, 60), /* at times several in one step */
                 .stop = &system->stop};
    *instance = (FmuInstance){.component = toy,
                           .do_step = (Function)do_step_of_toy,
                           .get_state = (Function)save_toy,
                           .set_state = (Function)restore_toy,
                           .state = &system->states[i],
                           .setters = &system->calls[2 * i],
                           .getters = &system->calls[2 * i + 1],
                           .n_setters = 1,
                           .n_getters = 1,
                           .code = 100 * (i + 1),
                           .first_input = first_input,
                           .n_inputs = below(dice, MOST_INPUTS + 1),
                           .first_output = first_output,
                           .n_outputs = N_OUTPUTS,
                           .mode = happens(dice, 0.5) ? HOLD : MIDDLE};
    instance->is_held = instance->mode == HOLD;
    if (happens(dice, 0.5)) instance->effort = &system->efforts[i];
    system->efforts[i].now = effort_clock;
    for (int32_t k = 0; k < 2; k++)
        system->calls[2 * i + k] = (Call){.function = k == 0 ? (Function)set_toy : (Function)get_toy,
                                          .component = toy,
                                          .references = references,
                                          .values = k == 0 ? system->input_values + first_input
                                                           : system->now + first_output,
                                          .n_references = k == 0 ? instance->n_inputs : N_OUTPUTS,
                                          .instance = i};
    for (int32_t k = 0; k < MOST_INPUTS; k++)
        system->inputs[first_input + k] = (Input){.factor = uniform(dice, -0.5, 0.5),
                                                  .offset = uniform(dice, -0.5, 0.5),
                                                  .signal = below(dice, N_OUTPUTS * system->n_instances),
                                                  .moves = 1};
    for (int32_t k = 0; k < N_OUTPUTS; k++)
        system->signals[first_output + k] = (Signal){.floor = 0.1, .instance = i, .is_smooth = happens(dice, 0.5)};
}

/* Make a loop of two instances; at times one with so few sweeps that it does not agree. */
static void build_group(System *system, int32_t g, Dice *dice) {
    Stepper *s = &system->stepper;
    for (int32_t m = 0; m < 2; m++) {
        const int32_t i = 2 * g + m;
        system->members[g][m] = i;
        system->coupling[g][m] = N_OUTPUTS * i;
        system->every[i] = 1;
        system->instances[i].n_inputs = MOST_INPUTS;
        system->inputs[MOST_INPUTS * i].signal = N_OUTPUTS * (2 * g + 1 - m);
        for (int32_t call = SET_INPUTS; call <= GET_OUTPUTS; call++)
            system->of_groups[g][3 * m + call] = (Operation){.every = 1, .call = call, .target = i};
    }
    memset(system->jacobian[g], 0, sizeof system->jacobian[g]);
    system->jacobian[g][0] = system->jacobian[g][3] = 0.9;
    system->groups[g] = (Group){.members = system->members[g],
                                .coupling = system->coupling[g],
                                .operations = system->of_groups[g],
                                .jacobian = system->jacobian[g],
                                .guess = system->memory[g][0],
                                .sizes = system->memory[g][1],
                                .direction = system->memory[g][2],
                                .earlier = system->memory[g][3],
                                .basis = system->memory[g][4],
                                .residuals = system->residuals[g],
                                .answers = system->answers[g],
                                .kept = system->kept[g],
                                .n_members = 2,
                                .n_coupling = 2,
                                .n_operations = 6,
                                .is_saved = 1,
                                .is_halved = happens(dice, 0.8)};
    s->operations = system->operations;
    system->operations[s->n_operations++] = (Operation){.every = 1, .call = SOLVE, .target = g};
}

/* Set, step and get the other instances: all sets first and all gets last, or one instance after the other. */
static void build_program(System *system, Dice *dice) {
    Stepper *s = &system->stepper;
    const int in_turn = happens(dice, 0.5);
    const int32_t first = 2 * s->n_groups, n = system->n_instances - first;
    for (int32_t o = 0; o < 3 * n; o++) {
        const int32_t i = first + (in_turn ? o / 3 : o % n), call = in_turn ? o % 3 : o / n;
        system->operations[s->n_operations++] = (Operation){.every = system->every[i], .call = call, .target = i};
    }
}

static System *build_system(uint64_t seed) {
    static const int modes[] = {FE_TONEAREST, FE_UPWARD, FE_TOWARDZERO};
    System *system = calloc(1, sizeof *system);
    Dice dice = {seed};
    if (system == NULL) abort();
    Stepper *s = &system->stepper;
    fesetround(modes[below(&dice, 3)]);
    system->n_instances = between(&dice, 2, MOST_INSTANCES);
    for (int32_t i = 0; i < system->n_instances; i++) {
        system->every[i] = happens(&dice, 0.7) ? 1 : between(&dice, 2, 3);
        build_instance(system, i, &dice);
    }
    s->n_groups = below(&dice, system->n_instances < 4 ? 2 : 3);
    for (int32_t g = 0; g < s->n_groups; g++) build_group(system, g, &dice);
    build_program(system, &dice);
    for (int32_t k = 0; k < N_OUTPUTS * system->n_instances; k++) system->read[k] = k;
    system->stores[SIGNALS] = system->now;
    system->stores[PREVIOUS] = system->previous;
    s->instances = system->instances;
    s->inputs = system->inputs;
    s->signals = system->signals;
    s->operations = system->operations;
    s->groups = system->groups;
    s->read = system->read;
    s->n_read = s->n_signals = N_OUTPUTS * system->n_instances;
    s->coupling_tolerance = 1e-6;
    s->sweeps = happens(&dice, 0.8) ? MOST_SWEEPS : between(&dice, 1, 3);
    s->halvings = 3;
    s->stores = system->stores;
    s->follows = system->follows;
    s->at = system->at;
    s->before = system->before;
    s->input_values = system->input_values;
    s->derivatives = system->derivatives;
    s->taken = system->taken;
    s->taken_at = system->taken_at;
    s->largest = system->largest;
    s->activity = &system->activities[0];
    s->stop = &system->stop;
    s->last_point = INFINITY;
    s->clock = (Clock){0.0, 1.0, 10.0};
    return system;
}

/* ---- lanes ----------------------------------------------------------------------------- */

/* The instances that an operation calls, and those whose outputs it reads or writes, as bits. */
typedef struct {
    uint32_t calls, reads, writes;
} Use;

static uint32_t sources_of(const System *system, int32_t i) {
    uint32_t sources = 0;
    for (int32_t k = 0; k < system->instances[i].n_inputs; k++)
        sources |= 1u << system->signals[system->inputs[MOST_INPUTS * i + k].signal].instance;
    return sources;
}

static Use use_of(const System *system, const Operation *operation) {
    const int32_t i = operation->target;
    if (operation->call == SOLVE) {
        const uint32_t members = 3u << 2 * i;
        return (Use){members, sources_of(system, 2 * i) | sources_of(system, 2 * i + 1), members};
    }
    return (Use){.calls = 1u << i,
                 .reads = operation->call == SET_INPUTS ? sources_of(system, i) : 0,
                 .writes = operation->call == GET_OUTPUTS ? 1u << i : 0};
}

static int depends(Use later, Use earlier) {
    return (later.calls & earlier.calls) || (later.reads & earlier.writes) || (later.writes & earlier.reads) ||
           (later.writes & earlier.writes);
}

typedef struct {
    LanePlan plans[MOST_LANES];
    Task tasks[MOST_LANES][MOST_ROWS];
    Wait waits[MOST_ROWS][MOST_LANES];
    int32_t n_lanes;
} Sharing;

/* Share the operations at random, all of an instance in one lane, in any order that their dependencies leave. */
static void share(System *system, Sharing *sharing, Dice *dice) {
    const Stepper *s = &system->stepper;
    int32_t lane_of[MOST_INSTANCES], lane_at[MOST_ROWS], number[MOST_ROWS], is_done[MOST_ROWS] = {0};
    memset(sharing, 0, sizeof *sharing);
    sharing->n_lanes = between(dice, 1, MOST_LANES);
    for (int32_t i = 0; i < system->n_instances; i++) lane_of[i] = below(dice, sharing->n_lanes);
    for (int32_t left = s->n_operations; left > 0;) {
        const int32_t o = below(dice, s->n_operations);
        const Operation *operation = &s->operations[o];
        const Use use = use_of(system, operation);
        int is_possible = !is_done[o];
        for (int32_t p = 0; p < o; p++)
            is_possible = is_possible && (is_done[p] || !depends(use, use_of(system, &s->operations[p])));
        if (!is_possible) continue;
        const int32_t lane = lane_of[operation->call == SOLVE ? 2 * operation->target : operation->target];
        LanePlan *plan = &sharing->plans[lane];
        Task *task = &sharing->tasks[lane][plan->n_tasks++];
        *task = (Task){.waits = sharing->waits[o], .operation = o};
        for (int32_t p = 0; p < o; p++) {
            if (lane_at[p] == lane || !depends(use, use_of(system, &s->operations[p]))) continue;
            int32_t w = 0;
            while (w < task->n_waits && sharing->waits[o][w].lane != lane_at[p]) w++;
            Wait *wait = &sharing->waits[o][w];
            if (w == task->n_waits) task->n_waits++, *wait = (Wait){lane_at[p], 0};
            if (number[p] > wait->tasks) wait->tasks = number[p];
        }
        lane_at[o] = lane;
        number[o] = (int32_t)plan->n_tasks;
        is_done[o] = 1;
        left--;
    }
    for (int32_t n = 0; n < sharing->n_lanes; n++) {
        sharing->plans[n].tasks = sharing->tasks[n];
        sharing->plans[n].activity = &system->activities[n];
    }
}

/* ---- runs ------------------------------------------------------------------------------ */

typedef struct {
    double rows[N_STEPS + 1][1 + MOST_SIGNALS];
    int64_t recorded, reached, sweeps, counts[MOST_INSTANCES][N_KINDS];
    int32_t failure, instance, status, group, n_halves, n_interruptions;
} Outcome;

/* Do all steps by one thread if `dice` is NULL, otherwise in parts by lanes, or some by one thread. */
static void run_system(uint64_t seed, Dice *dice, Outcome *outcome) {
    System *system = build_system(seed);
    Stepper *s = &system->stepper;
    Sharing *sharing = calloc(1, sizeof *sharing);
    Lanes *lanes = NULL;
    memset(outcome, 0, sizeof *outcome);
    if (sharing == NULL) abort();
    if (dice != NULL) {
        share(system, sharing, dice);
        lanes = lanes_start(s, sharing->plans, sharing->n_lanes);
        REQUIRE(lanes != NULL, "the system has too few threads");
    }
    for (int64_t k = 0; k < N_STEPS && outcome->failure == DONE;) {
        double *rows = allocate(N_STEPS * (1 + (size_t)s->n_signals), sizeof *rows);
        const int64_t count = dice == NULL ? N_STEPS - k : between(dice, 1, (int32_t)(N_STEPS - k));
        const int32_t failure = dice == NULL || happens(dice, 0.2) ? stepper_run(s, k, count, 1, rows)
                                                                   : lanes_run(lanes, k, count, 1, rows);
        for (int64_t r = 0; r < s->recorded; r++)
            memcpy(outcome->rows[outcome->recorded++], rows + r * (1 + s->n_signals),
                   (1 + (size_t)s->n_signals) * sizeof *rows);
        free(rows);
        k = s->reached;
        outcome->sweeps += s->sweeps_done;
        REQUIRE(failure == s->failure, "the failure is another one");
        if (failure == LATE) continue;
        outcome->n_interruptions += failure == INTERRUPTED;
        system->stop = 0;
        if (failure != INTERRUPTED) outcome->failure = failure;
    }
    if (lanes != NULL) lanes_end(lanes);
    outcome->reached = s->reached;
    outcome->instance = s->instance, outcome->status = s->status, outcome->group = s->group;
    for (int32_t i = 0; i < system->n_instances; i++) {
        outcome->n_halves += system->toys[i].n_halves;
        for (int32_t kind = 0; kind < N_KINDS; kind++) outcome->counts[i][kind] = system->efforts[i].counts[kind];
    }
    for (int32_t n = 0; n < MOST_LANES && (outcome->failure == DONE || outcome->failure == NOT_FINITE); n++)
        REQUIRE(system->activities[n].code == 0, "an instance is still busy");
    free(sharing);
    free(system);
}

static void compare_outcomes(const Outcome *alone, const Outcome *shared) {
    REQUIRE(alone->failure == shared->failure && alone->reached == shared->reached, "lanes end elsewhere");
    REQUIRE(alone->recorded == shared->recorded, "lanes record other rows");
    REQUIRE(memcmp(alone->rows, shared->rows, sizeof alone->rows) == 0, "lanes have other rows");
    if (alone->failure == NO_AGREEMENT) REQUIRE(alone->group == shared->group, "lanes blame another group");
    if (alone->failure == STEP_FAILED)
        REQUIRE(alone->instance == shared->instance && alone->status == shared->status,
                "lanes blame another instance");
    if (alone->failure != DONE) return;
    REQUIRE(alone->sweeps == shared->sweeps, "lanes make another number of sweeps");
    REQUIRE(alone->n_interruptions == shared->n_interruptions, "lanes stop elsewhere");
    REQUIRE(memcmp(alone->counts, shared->counts, sizeof alone->counts) == 0, "lanes count other calls");
}

static void run_seed(uint64_t seed) {
    Outcome *alone = allocate(1, sizeof *alone), *shared = allocate(1, sizeof *shared);
    Dice dice = {~seed};
    run_system(seed, NULL, alone);
    occurred[FAILURES] += alone->failure == STEP_FAILED;
    occurred[HALVES] += alone->failure == DONE && alone->n_halves > 0;
    occurred[DISAGREEMENTS] += alone->failure == NO_AGREEMENT;
    occurred[INTERRUPTIONS] += alone->n_interruptions > 0;
    for (int way = 0; way < N_WAYS; way++) {
        run_system(seed, &dice, shared);
        compare_outcomes(alone, shared);
    }
    free(alone);
    free(shared);
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fputs("Usage: lanes_host FIRST_SEED SEEDS\n", stderr);
        return 2;
    }
    const uint64_t first = strtoull(argv[1], NULL, 10), count = strtoull(argv[2], NULL, 10);
    watch_for_death();
    host_locale = newlocale(LC_ALL_MASK, "C", no_locale);
    uselocale(host_locale);
    for (uint64_t seed = first; seed < first + count; seed++) {
        present_seed = seed;
        run_seed(seed);
    }
    uselocale(LC_GLOBAL_LOCALE);
    freelocale(host_locale);
    for (int n = 0; n < N_OCCURRENCES; n++) printf("%s %lld ", occurrence_names[n], (long long)occurred[n]);
    printf("\n");
    return 0;
}
