/* Steps of an instance of FMI 3.0 with event mode, clocks or early returns.
 *
 * A step ends at the time that was asked for: after an event before it, the rest follows as another step of the FMU.
 * Discrete inputs change in event mode, at the start of a step. Clocks tick at their times, at the end of a step with
 * the inputs of that step; clocked inputs change then. Triggered input clocks tick at the end of a step, as often as
 * the clocks that drive them have ticked until then.
 */

#define SAME_TIME 1e-9    /* times that differ by less than this part of a step are the same */
#define MOST_UPDATES 1000 /* at one time: updates of discrete states, early returns, and ticks of a triggered clock */

/* Return the distance of a time to the next larger double. */
static double spacing(double time) { return nextafter(fabs(time), INFINITY) - fabs(time); }

/* Return the time of the next time event or tick in s; infinite without one. */
static double next_event(const Events *e) {
    const double tick = next_tick(e);
    return e->memory[NEXT_EVENT] < tick ? e->memory[NEXT_EVENT] : tick;
}

static int32_t switch_mode(const Stepper *s, Events *e, int32_t call) {
    announce(s, e->codes[call]);
    const int32_t status = (int32_t)((fmi3EnterEventModeTYPE *)e->functions[call])(e->component);
    return is_bad(status) ? blame_call(e, call, status) : NO_PROBLEM;
}

NOINLINE static int32_t end_run(Events *e, int32_t call, double time) {
    e->call = call;
    e->value = time;
    return blame(e, RUN_ENDED);
}

NOINLINE static int32_t blame_count(Events *e, int32_t problem, int32_t count) {
    e->count = count;
    return blame(e, problem);
}

/* Update the discrete states once. */
static int32_t update_states(const Stepper *s, Events *e, fmi3Boolean *needs_more) {
    fmi3Boolean ends = fmi3False, has_nominals = fmi3False, has_values = fmi3False, has_next = fmi3False;
    double next = 0.0;
    *needs_more = fmi3False;
    announce(s, e->codes[FMI_UPDATE_DISCRETE_STATES]);
    const int32_t status = (int32_t)((fmi3UpdateDiscreteStatesTYPE *)e->functions[FMI_UPDATE_DISCRETE_STATES])(
        e->component, needs_more, &ends, &has_nominals, &has_values, &has_next, &next);
    if (is_bad(status)) return blame_call(e, FMI_UPDATE_DISCRETE_STATES, status);
    if (has_next && isnan(next)) return blame(e, NO_EVENT_TIME); /* it would compare as never */
    e->memory[NEXT_EVENT] = has_next ? next : INFINITY;
    if (ends) e->memory[END_REQUEST] = e->time;
    return NO_PROBLEM;
}

/* Tick clocks up to `near` s after now, and update the discrete states until the FMU needs no more of it. */
static int32_t update_until_settled(const Stepper *s, Events *e, double near, int is_triggered) {
    const double until = e->time + near;
    const size_t n_clocks = (size_t)e->n_clocks;
    if (n_clocks > 0) memset(e->marks, 0, n_clocks);
    for (int32_t n = 0; n < MOST_UPDATES; n++) {
        fmi3Boolean needs_more;
        int32_t found = 0, problem = tick(s, e, until, is_triggered);
        if (problem == NO_PROBLEM) problem = update_states(s, e, &needs_more);
        if (problem == NO_PROBLEM) problem = advance_clocks(s, e, until);
        if (problem != NO_PROBLEM) return problem;
        if (n_clocks > 0) memset(e->marks, 0, n_clocks);
        if (needs_more || (is_triggered && is_any_triggered(e)) || next_tick(e) <= until) continue;
        problem = find_output_ticks(s, e, &found); /* an FMU may set them as late as in the update */
        if (problem != NO_PROBLEM || found == 0) return problem;
    }
    for (int32_t c = 0; c < e->n_clocks; c++) {
        if (e->marks[c] != TICKS) continue;
        e->clock = c;
        return blame_count(e, ENDLESS_TICKS, MOST_UPDATES);
    }
    return blame_count(e, ENDLESS_UPDATES, MOST_UPDATES);
}

static int32_t pass_discrete_inputs(const Stepper *s, Events *e) {
    if (e->n_discrete == 0) return NO_PROBLEM;
    const int32_t status = set_converted(s, e->discrete_setters, e->n_discrete_setters, e->inputs);
    if (is_bad(status)) return blame_call(e, SETTING_INPUTS, status);
    for (int32_t k = 0; k < e->n_discrete; k++) e->passed[k] = e->inputs[e->discrete[k]];
    return NO_PROBLEM;
}

static int has_new_inputs(const Events *e) {
    for (int32_t k = 0; k < e->n_discrete; k++)
        if (e->passed[k] != e->inputs[e->discrete[k]]) return 1;
    return 0;
}

/* Handle an event at the present time; with `is_triggered`, triggered clocks tick, too. */
static int32_t handle_event(const Stepper *s, Events *e, double near, int is_triggered) {
    int32_t problem = switch_mode(s, e, FMI_ENTER_EVENT_MODE);
    if (problem == NO_PROBLEM) problem = pass_discrete_inputs(s, e);
    if (problem == NO_PROBLEM) problem = update_until_settled(s, e, near, is_triggered);
    return problem == NO_PROBLEM ? switch_mode(s, e, FMI_ENTER_STEP_MODE) : problem;
}

/* Judge an early return; one that is not declared is accepted if the rest of the step can follow as another one. */
NOINLINE static int32_t accept_return(Events *e, double length, double reached) {
    const double low = e->time - spacing(e->time), end = e->time + length;
    if (!e->may_return_early) {
        if (!(e->has_event_mode && e->varies_step)) return blame(e, RETURN_REFUSED);
        if (isnan(e->first_return)) e->first_return = e->time;
    }
    if (low <= reached && reached <= end + spacing(end)) return NO_PROBLEM;
    e->value = reached;
    return blame(e, WRONG_TIME);
}

/* Do one step of the FMU; `reached` is the time at its end, and `has_event` whether it needs event mode. */
static int32_t step_once(const Stepper *s, Events *e, double length, int32_t has_no_way_back, double *reached,
                         fmi3Boolean *has_event) {
    fmi3Boolean ends = fmi3False, is_early = fmi3False;
    double last = 0.0;
    *reached = e->time + length;
    *has_event = fmi3False;
    announce(s, e->codes[FMI_DO_STEP]);
    const int32_t status = (int32_t)((fmi3DoStepTYPE *)e->functions[FMI_DO_STEP])(
        e->component, e->time, length, has_no_way_back != 0, has_event, &ends, &is_early, &last);
    if (is_bad(status)) return blame_call(e, FMI_DO_STEP, status);
    if (ends) return end_run(e, FMI_DO_STEP, e->time);
    if (is_early) *reached = last;
    if (*has_event && !e->has_event_mode) return blame(e, EVENT_REFUSED);
    return is_early ? accept_return(e, length, last) : NO_PROBLEM;
}

/* Return the time in s to which the next step of the FMU goes. */
static double find_next_stop(const Events *e, double end, double near) {
    const double next = next_event(e);
    return e->varies_step && e->time + near < next && next < end - near ? next : end;
}

/* Step to `end`, with all events on the way. */
static int32_t step_to(const Stepper *s, Events *e, double end, double near, int32_t has_no_way_back) {
    int32_t n_returns = 0;
    for (;;) {
        double reached;
        fmi3Boolean has_event;
        if (!e->varies_step && next_tick(e) < end - near) {
            e->value = next_tick(e);
            return blame(e, TICK_WITHIN_STEP);
        }
        const double length = find_next_stop(e, end, near) - e->time;
        int32_t problem = step_once(s, e, length, has_no_way_back, &reached, &has_event);
        if (problem != NO_PROBLEM) return problem;
        n_returns = reached <= e->time + near ? n_returns + 1 : 0;
        if (n_returns > MOST_UPDATES) return blame_count(e, ENDLESS_RETURNS, n_returns);
        const int is_end = reached >= end - near;
        e->time = is_end ? end : reached;
        const int is_triggered = is_end && is_any_triggered(e);
        if (has_event || is_triggered || e->time >= next_event(e) - near) {
            problem = handle_event(s, e, near, is_triggered);
            if (problem != NO_PROBLEM) return problem;
        }
        if (is_end) return NO_PROBLEM;
        if (!isnan(e->memory[END_REQUEST]))
            return end_run(e, FMI_UPDATE_DISCRETE_STATES, e->memory[END_REQUEST]);
    }
}

/* Return the problem if a triggered clock has to tick too often in a step until `end`. */
static int32_t check_triggered(Events *e, double end) {
    for (int32_t k = 0; k < e->n_triggered; k++) {
        const double missing = count_missing_ticks(e, &e->triggered[k]);
        if (!(missing >= MOST_UPDATES)) continue;
        e->count = missing < INT32_MAX ? (int32_t)missing : INT32_MAX;
        return blame_clock(e, TOO_MANY_TICKS, e->triggered[k].clock, end);
    }
    return NO_PROBLEM;
}

/* Step from `time` by `length`, and handle the events in between and at the end. Returns a status, which is DISCARD only
   if the FMU discards a step. */
NOINLINE static int32_t step_with_events(const Stepper *s, Events *e, double time, double length, int32_t has_no_way_back) {
    const double end = time + length, rounding = 4.0 * spacing(end);
    const double near = SAME_TIME * length > rounding ? SAME_TIME * length : rounding;
    e->time = time;
    e->problem = NO_PROBLEM;
    int32_t problem = check_triggered(e, end);
    if (problem == NO_PROBLEM && !isnan(e->memory[END_REQUEST]))
        problem = end_run(e, FMI_UPDATE_DISCRETE_STATES, e->memory[END_REQUEST]);
    if (problem == NO_PROBLEM && has_new_inputs(e)) problem = handle_event(s, e, near, 0);
    if (problem == NO_PROBLEM) problem = step_to(s, e, end, near, has_no_way_back);
    e->memory[PRESENT] = e->time;
    if (problem == NO_PROBLEM) return fmi2OK;
    return problem == CALL_FAILED && e->call == FMI_DO_STEP && e->status == fmi2Discard ? fmi2Discard : fmi2Error;
}
