/* A block with a periodic input clock: a tick is a step whose length is the interval of the clock.
 *
 * Inputs, states and outputs can be set and read only while the clock ticks, in event mode. Until the update of
 * discrete states, each read computes the tick with the present inputs, so that hosts can solve loops. Steps between
 * ticks only pass time.
 */

#define CLOCK_REFERENCE N_VARIABLES

static void advance(Instance *instance, const double *u0);

static int is_clocked(ValueReference reference) {
    return reference < N_INPUTS || (reference >= FIRST_STATE && reference < N_VALUES);
}

static Status check_clocked(const Instance *instance, ValueReference reference) {
    if (instance->now.ticking || instance->now.phase & (INSTANTIATED | INITIALIZATION | TERMINATED)) return StatusOK;
    if (!is_clocked(reference)) return StatusOK;
    return report(instance, StatusError, "%s can be set and read only while the clock ticks.",
                  variables[reference].name);
}

/* The first tick is one interval after the start. */
static void start_clock(State *now) { now->clock = (StepClock){now->time, CLOCK_INTERVAL, 0.0}; }

static double next_tick(const State *now) {
    StepClock clock = now->clock;
    clock.count += 1.0;
    return clock_time(&clock);
}

/* Whether a time is that of the next tick, but for rounding. */
static int is_tick(const State *now, double time) {
    return fabs(time - next_tick(now)) <= SAME_TIME * CLOCK_INTERVAL + TIME_ROUNDING * fabs(time);
}

/* Do the step of a tick. If a value is not finite, the instance stays as it was. */
static Status tick(Instance *instance) {
    State *now = &instance->now;
    double u0[ROOM(N_INPUTS)];
    instance->before = *now;
    memcpy(u0, now->values, N_INPUTS * sizeof(double));
    now->time = clock_time(&now->clock);
    advance(instance, u0);
    hold_inputs(now, now->clock.step);
    const int bad = find_not_finite(now);
    if (bad < 0) return StatusOK;
    const double value = now->values[bad];
    *now = instance->before;
    return report(instance, StatusError, "the tick at t = %.9g s is impossible: %s became %g.", now->time,
                  variables[bad].name, value);
}

/* Compute what the host sees: the present state, or while the clock ticks the one after the tick. */
static Status show(Instance *instance) {
    if (instance->now.ticking) {
        if (tick(instance) != StatusOK) return StatusError;
        instance->shown = instance->now;
        instance->now = instance->before;
    } else
        instance->shown = instance->now;
    return StatusOK;
}
