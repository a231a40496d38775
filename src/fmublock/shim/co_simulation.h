/* Co-simulation: the communication step and its status. */

/* By how much a host's time may differ from the instance's own through rounding. */
static double rounding(const State *now, double time, double step) {
    const double last = now->clock.step;
    return SAME_TIME * fmax(step, last) + TIME_ROUNDING * fabs(time);
}

/* Whether a step exists only because the host rounds its times in another way. A first step never does:
   there is no earlier rounding, and only a step checks that outputs are finite. */
static int is_sliver(const State *now, double time, double step) {
    const double rounded = rounding(now, time, step);
    const int is_there = fabs(time - now->time) <= rounded && fabs(time + step - now->time) <= rounded;
    return now->clock.step > 0.0 && is_there;
}

static Status check_step(const Instance *instance, double time, double step) {
    const State *now = &instance->now;
    if (!(isfinite(time + step) && step > 0.0))
        return report(instance, StatusError, "the step size %g s is not a positive, finite number.", step);
    const double end = time + step;
    if (!(fabs(time - now->time) <= fmax(STEP_TOLERANCE * step, rounding(now, time, step)))) {
        const int digits = digits_apart(time, now->time);
        return report(instance, StatusError,
                      "the step starts at t = %.*g s, but the instance is at t = %.*g s.", digits, time,
                      digits, now->time);
    }
    if (end > now->stop_time + STEP_TOLERANCE * step + TIME_ROUNDING * fabs(time)) {
        const int digits = digits_apart(end, now->stop_time);
        return report(instance, StatusError, "the step to t = %.*g s goes past the stop time %.*g s.", digits,
                      end, digits, now->stop_time);
    }
    return check_substeps(instance, step);
}

/* A step past the end of the resource is discarded: the FMU asks the host to end the run there. */
static Status check_end(Instance *instance, double time, double step) {
    const double last = RESOURCE_END(&instance->now);
    instance->ended = time + step > last + STEP_TOLERANCE * step + TIME_ROUNDING * fabs(time);
    if (!instance->ended) return StatusOK;
    return report(instance, StatusDiscard, "the data end at t = %.9g s, and the step to t = %.9g s goes past it.",
                  last, time + step);
}

/* Begin a step on the instance's own clock: its next one if the host's time and step differ by rounding only. */
static void begin_step(State *now, double time, double step) {
    StepClock *clock = &now->clock;
    const int goes_on =
        fabs(step - clock->step) <= SAME_STEP * clock->step && fabs(time - now->time) <= SAME_TIME * step;
    if (!goes_on) *clock = (StepClock){time, step, 0.0};
    now->time = clock_time(clock);
}

/* Clear what the host set for one step; `begin` is the time before which it will not go back. */
static Status end_step(Instance *instance, double begin, Boolean will_not_go_back) {
    State *now = &instance->now;
    memset(now->input_derivatives, 0, sizeof now->input_derivatives);
    now->inputs_move = 0;
    if (will_not_go_back) instance->no_return_before = begin;
    return StatusOK;
}

/* Do the step of the instance's clock. If it ends early, it is a step of another length. */
static void advance(Instance *instance, const double *u0) {
    State *now = &instance->now;
    StepClock *clock = &now->clock;
    const double step = integrate(instance, u0, now->time, clock->step);
    if (step < clock->step) *clock = (StepClock){now->time, step, 0.0};
    if (now->inputs_move) move_inputs(now, u0, step);
    clock->count += 1.0;
    now->time = clock_time(clock);
    end_communication_step(now);
}

static Status do_step(Instance *instance, double time, double step, Boolean noSetFMUStatePriorToCurrentPoint) {
    State *now = &instance->now;
    const double start = now->time;
    const StepClock clock = now->clock;
    double u0[ROOM(N_INPUTS)], before[ROOM(N_EVOLVING)];
    if (require(instance, STEP, "do a step") != StatusOK) return StatusError;
#ifdef HAS_INTERMEDIATE_UPDATE
    begin_intermediate_updates(instance);
#endif
    if (check_step(instance, time, step) != StatusOK) return StatusError;
    if (is_sliver(now, time, step)) return end_step(instance, start, noSetFMUStatePriorToCurrentPoint);
    if (check_end(instance, time, step) != StatusOK) return StatusDiscard;
    memcpy(u0, now->values, N_INPUTS * sizeof(double));
    memcpy(before, now->values + FIRST_STATE, N_EVOLVING * sizeof(double));
    begin_step(now, time, step);
    const double begin = now->time;
    advance(instance, u0);
    const int bad = find_not_finite(now);
    if (bad >= 0) {
        const double value = now->values[bad];
        now->time = start;
        now->clock = clock;
        memcpy(now->values, u0, N_INPUTS * sizeof(double));
        memcpy(now->values + FIRST_STATE, before, N_EVOLVING * sizeof(double));
        return report(instance, StatusDiscard,
                      "step from t = %.9g s with h = %.9g s discarded: %s became %g.", time, step,
                      variables[bad].name, value);
    }
    hold_inputs(now, now->clock.step);
    report_limits(instance);
#ifdef HAS_INTERMEDIATE_UPDATE
    end_intermediate_updates(instance);
#endif
    return end_step(instance, begin, noSetFMUStatePriorToCurrentPoint);
}

static double reached_time(const Instance *instance) { return instance->now.time; }

/* Equations never end a run by themselves; data do. */
static int has_ended(const Instance *instance) { return instance->ended; }
