/* The block's equations. The arithmetic repeats fmublock/instance.py operation by operation, so
 * that both give the same bits. Compile without floating-point contraction.
 */

#ifndef FIXED /* a resource may define it */
#define FIXED(state) ((state)->fixed)
#endif

/* Compute what depends on parameters only, whenever these may have changed. */
static void fix_values(State *now) { fixed_values(now->values, now->fixed); }

/* In co-simulation outputs and derivatives are frozen between communication points: they belong to the
 * inputs of the last step, whatever has been set since.
 */
static void evaluate_derivatives(State *now) {
    double set[ROOM(N_INPUTS)];
    const int frozen = now->type == FOR_CO_SIMULATION && now->phase & (STEP | TERMINATED);
    memcpy(set, now->values, N_INPUTS * sizeof(double));
    if (frozen) memcpy(now->values, now->held, N_INPUTS * sizeof(double));
    double stepwise[ROOM(N_STEPWISE)];
    stepwise_values(now->values, FIXED(now), stepwise);
    derivatives(now->time, now->values, FIXED(now), stepwise, now->values + FIRST_DERIVATIVE);
    memcpy(now->values, set, N_INPUTS * sizeof(double));
}

static void evaluate_outputs(State *now) {
    outputs(now->time, now->values, FIXED(now), now->values + FIRST_OUTPUT);
}

/* End a communication step: discrete states, and the outputs that belong to them. */
static void end_communication_step(State *now) {
    double next[ROOM(N_DISCRETE_STATES)];
    update_and_outputs(now->time, now->values, FIXED(now), next, now->values + FIRST_OUTPUT);
    memcpy(now->values + FIRST_DISCRETE_STATE, next, N_DISCRETE_STATES * sizeof(double));
}

/* ---- inputs within a step -------------------------------------------------------------- */

/* Inputs at `elapsed` seconds into a step that began with u0 and the input derivatives. */
static void move_inputs(State *now, const double *u0, double elapsed) {
    for (int i = 0; i < N_INPUTS; i++) {
        const double *d = now->input_derivatives[i];
        now->values[i] = u0[i] + elapsed * (d[0] + elapsed * (d[1] / 2.0 + elapsed * d[2] / 6.0));
    }
}

/* Save the inputs with which the outputs were computed, `elapsed` seconds into a step. */
static void hold_inputs(State *now, double elapsed) {
    for (int i = 0; i < N_INPUTS; i++) {
        const double *d = now->input_derivatives[i];
        now->held[i] = now->values[i];
        now->held_rates[i] = d[0] + elapsed * (d[1] + elapsed * d[2] / 2.0);
    }
}

/* ---- intermediate update --------------------------------------------------------------- */

/* Value reference of a state or output that is not finite, or -1. */
static int find_not_finite(const State *now) {
    for (int r = FIRST_STATE; r < FIRST_DERIVATIVE; r++)
        if (!isfinite(now->values[r])) return r;
    return -1;
}

#ifdef HAS_INTERMEDIATE_UPDATE
#include "fmi3_intermediate_update.h"
#else
static Status check_required(const Instance *instance, const ValueReference vr[], size_t nvr) {
    (void)instance, (void)vr, (void)nvr;
    return StatusOK;
}
#endif

#ifdef CLOCK_INTERVAL
#include "fmi3_clocked.h"
#define SEEN(instance) (&(instance)->shown)
#else
#define SEEN(instance) (&(instance)->now)
#endif

/* ---- integration ----------------------------------------------------------------------- */

#include "runge_kutta.h"

static double substeps(const State *now, double step) {
#if N_STATES > 0
    return count_substeps(step, now->values[INTERNAL_STEP]);
#else
    (void)now, (void)step;
    return 1.0;
#endif
}

#if N_STATES > 0
/* A step under way. `stepwise` depends on inputs and discrete states; it changes within a step only if inputs do. */
typedef struct {
    Instance *instance;
    const double *u0; /* inputs at its start */
    double start;
    double stepwise[ROOM(N_STEPWISE)];
} Step;

static inline void slope(void *context, double time, double *k) {
    Step *step = context;
    State *now = &step->instance->now;
    if (now->inputs_move) {
        move_inputs(now, step->u0, time - step->start);
        stepwise_values(now->values, FIXED(now), step->stepwise);
    }
    derivatives(time, now->values, FIXED(now), step->stepwise, k);
}

#ifdef HAS_INTERMEDIATE_UPDATE
static int ends_step_early(void *context, double done, double next) {
    const Step *step = context;
    return ends_early(step->instance, step->start + done, step->start + next);
}
#define ENDS_EARLY(instance) ((instance)->intermediate_update != NULL ? ends_step_early : NULL)
#else
#define ENDS_EARLY(instance) NULL
#endif

/* Do a step of the states. Returns its length, which is less if it ended early. */
static double integrate(Instance *instance, const double *u0, double time, double step) {
    State *now = &instance->now;
    Step under_way; /* without an initializer, which would clear `stepwise` in vain */
    double memory[5 * N_STATES];
    under_way.instance = instance;
    under_way.u0 = u0;
    under_way.start = time;
    stepwise_values(now->values, FIXED(now), under_way.stepwise);
    return runge_kutta(N_STATES, now->values + FIRST_STATE, memory, time, step, now->values[INTERNAL_STEP], slope,
                       ENDS_EARLY(instance), &under_way);
}
#else
static double integrate(Instance *instance, const double *u0, double time, double step) {
    (void)instance, (void)u0, (void)time;
    return step;
}
#endif

/* ---- start values ---------------------------------------------------------------------- */

static void set_start_values(State *now, int type) {
    const double *resource = now->resource;
    memset(now, 0, sizeof *now);
    now->resource = resource;
    memcpy(now->guid, GUID(now), sizeof now->guid);
    now->type = type;
    now->phase = INSTANTIATED;
    now->stop_time = HUGE_VAL;
    for (int r = 0; r < N_VALUES; r++) now->values[r] = variables[r].start;
}

/* Take the start values that come from parameters, and the start time. */
static void take_start_values(State *now) {
    for (int r = FIRST_STATE; r < FIRST_OUTPUT; r++) {
        if (variables[r].start_reference >= 0) now->values[r] = now->values[variables[r].start_reference];
        if (variables[r].start_reference == STARTS_AT_START_TIME) now->values[r] = now->time;
    }
}

/* Take these start values and compute the outputs. */
static void initialize_values(State *now) {
    take_start_values(now);
    fix_values(now);
    evaluate_outputs(now);
}
