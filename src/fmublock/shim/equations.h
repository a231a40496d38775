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

static double substeps(const State *now, double step) {
#if N_STATES > 0
    const double count = ceil(step / now->values[INTERNAL_STEP] - SAME_COUNT);
    return count >= 1.0 ? count : 1.0;
#else
    (void)now, (void)step;
    return 1.0;
#endif
}

#if N_STATES > 0
/* `stepwise` depends on inputs and discrete states; it changes within a step only if inputs do. */
static void slope(State *now, const double *u0, double start, double time, double *stepwise, double *k) {
    if (now->inputs_move) {
        move_inputs(now, u0, time - start);
        stepwise_values(now->values, FIXED(now), stepwise);
    }
    derivatives(time, now->values, FIXED(now), stepwise, k);
}

static void set_states(double *x, const double *x0, double factor, const double *k) {
    for (int i = 0; i < N_STATES; i++) x[i] = x0[i] + factor * k[i];
}

/* Classical Runge-Kutta substeps no longer than the internal step. Returns the length of the step, which is less if
   it ended early. */
static double integrate(Instance *instance, const double *u0, double time, double step) {
    State *now = &instance->now;
    double x0[N_STATES], k1[N_STATES], k2[N_STATES], k3[N_STATES], k4[N_STATES], stepwise[ROOM(N_STEPWISE)];
    double *x = now->values + FIRST_STATE;
    const double count = substeps(now, step), dt = step / count;
    stepwise_values(now->values, FIXED(now), stepwise);
    for (long i = 0; i < (long)count; i++) {
        const double t = time + (double)i * dt;
        memcpy(x0, x, sizeof x0);
        slope(now, u0, time, t, stepwise, k1);
        set_states(x, x0, 0.5 * dt, k1);
        slope(now, u0, time, t + 0.5 * dt, stepwise, k2);
        set_states(x, x0, 0.5 * dt, k2);
        slope(now, u0, time, t + 0.5 * dt, stepwise, k3);
        set_states(x, x0, dt, k3);
        slope(now, u0, time, t + dt, stepwise, k4);
        for (int j = 0; j < N_STATES; j++) k1[j] = k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j];
        set_states(x, x0, dt / 6.0, k1);
#ifdef HAS_INTERMEDIATE_UPDATE
        if (instance->intermediate_update != NULL && i + 1 < (long)count) {
            const double done = (double)(i + 1) * dt;
            if (ends_early(instance, time + done, time + (double)(i + 2) * dt)) return done;
        }
#endif
    }
    return step;
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
