/* Event mode, clocks and early returns of parts of FMI 3.0: events.h of the stepper has what happens in steps. */

static Status end_run_of(Instance *instance, int i, double time) {
    instance->memory.ended = 1;
    return report(instance, StatusDiscard, "%s asks to end the simulation at t = %.9g s.", parts[i].name, time);
}

#if N_EVENTS > 0

#include "stepper/event_calls.h"

static Status blame_inputs(Instance *instance, int i, int32_t status);

static const char *const event_calls[] = {"a step",
                                          "fmi3EnterEventMode",
                                          "fmi3EnterStepMode",
                                          "fmi3UpdateDiscreteStates",
                                          "fmi3SetClock",
                                          "fmi3GetClock",
                                          "fmi3GetIntervalDecimal",
                                          "fmi3GetShiftDecimal",
                                          "the setting of its inputs",
                                          "the reading of clocked variables",
                                          "the setting of its inputs"};

/* Report what went wrong in the events of a part, or that it wants the end. */
static Status blame_events(Instance *instance, int i) {
    const Events *e = &instance->events[parts[i].events];
    const char *name = parts[i].name;
    const char *clock = parts[i].clocks[e->clock];
    if (e->problem == RUN_ENDED) return end_run_of(instance, i, e->value);
    if (e->problem == CALL_FAILED && e->status == OUT_OF_RANGE)
        return blame_inputs(instance, i, OUT_OF_RANGE);
    if (e->problem == CALL_FAILED && !(e->call == FMI_DO_STEP && e->status == fmi2Discard))
        return blame_part(instance, i, event_calls[e->call], e->status);
    instance->memory.phase = FAILED;
    switch (e->problem) {
        case CALL_FAILED:
            instance->memory.phase = STEP; /* a discarded step */
            return report(instance, StatusOK, "%s discarded the step from t = %.9g s.", name, e->time);
        case RETURN_REFUSED:
            return report(instance, StatusError, "%s returned early at t = %.9g s, which was not allowed.", name,
                          e->time);
        case EVENT_REFUSED:
            return report(instance, StatusError, "%s asked for event mode at t = %.9g s, which is not used.", name,
                          e->time);
        case WRONG_TIME:
            return report(instance, StatusError, "%s answered the step from t = %.9g s with lastSuccessfulTime = %.9g.",
                          name, e->time, e->value);
        case NO_EVENT_TIME:
            return report(instance, StatusError, "%s has the next event at NaN after t = %.9g s.", name, e->time);
        case ENDLESS_UPDATES:
        case ENDLESS_RETURNS:
            return report(instance, StatusError, "%s asked %d times in a row for more at t = %.9g s.", name, e->count,
                          e->time);
        case ENDLESS_TICKS:
            return report(instance, StatusError, "the clock %s of %s ticks after each of %d updates at t = %.9g s.",
                          clock, name, e->count, e->time);
        case TICK_WITHIN_STEP:
            return report(instance, StatusError,
                          "a clock of %s ticks at t = %.9g s, within a step, and the FMU cannot vary its step size.",
                          name, e->value);
        case TICK_ALONE:
            return report(instance, StatusError,
                          "the clock %s of %s ticks at t = %.9g s without one on which it depends.", clock, name,
                          e->time);
        case TOO_MANY_TICKS:
            return report(instance, StatusError, "the clock %s of %s has to tick %d times in the step to t = %.9g s.",
                          clock, name, e->count, e->value);
        default:
            return report(instance, StatusError, "the clock %s of %s has the %s %g s.", clock, name,
                          e->problem == WRONG_INTERVAL ? "interval" : "shift", e->value);
    }
}

/* Report early returns that are not declared and were accepted, once for each part. */
static void report_early_returns(Instance *instance) {
    for (int i = 0; i < N_PARTS; i++) {
        Events *e = parts[i].events < 0 ? NULL : &instance->events[parts[i].events];
        if (e == NULL || !(e->first_return > -HUGE_VAL)) continue;
        report(instance, StatusWarning, "%s returned early at t = %.9g s without declaring it; the rest of the step "
               "followed as another one.", parts[i].name, e->first_return);
        e->first_return = -HUGE_VAL;
    }
}

/* Forget all events of a part. */
static void forget_events(Instance *instance, int i) {
    const Part *part = &parts[i];
    if (part->events < 0) return;
    double *memory = &instance->memory.saved[part->first_event];
    for (int k = 0; k < part->n_event; k++) memory[k] = k < part->first_count ? NAN : 0.0;
    memory[NEXT_EVENT] = HUGE_VAL;
    instance->events[part->events].first_return = NAN;
}

/* Find the first ticks of a part, in initialization mode. */
static Status start_events(Instance *instance, int i) {
    if (parts[i].events < 0) return StatusOK;
    const int32_t problem = events_start(NULL, &instance->events[parts[i].events], instance->memory.start_time);
    return problem == NO_PROBLEM ? StatusOK : blame_events(instance, i);
}

/* Handle the events of a part at the start, after initialization mode. */
static Status handle_first_events(Instance *instance, int i) {
    if (parts[i].events < 0) return StatusOK;
    Events *events = &instance->events[parts[i].events];
    for (int k = 0; k < events->n_discrete; k++) events->passed[k] = events->inputs[events->discrete[k]];
    if (!events->has_event_mode || events_leave(NULL, events) == NO_PROBLEM) return StatusOK;
    return blame_events(instance, i);
}

/* Return the status of a change between steps. After a problem, the part is in no mode in which it can step. */
static int32_t judge_change(Instance *instance, int part, int32_t problem) {
    if (problem == NO_PROBLEM) return fmi2OK;
    blame_events(instance, part);
    return instance->memory.phase == DEAD ? fmi2Fatal : fmi2Error;
}

/* Let a part be changed between its steps; events that this causes are handled by `end_change`. */
static int32_t begin_change(Instance *instance, int part, int way) {
    if (way != IN_EVENT_MODE || instance->memory.phase != STEP) return fmi2OK;
    return judge_change(instance, part, events_enter(NULL, &instance->events[parts[part].events]));
}

static int32_t end_change(Instance *instance, int part, int way) {
    if (way != IN_EVENT_MODE || instance->memory.phase != STEP) return fmi2OK;
    return judge_change(instance, part, events_leave(NULL, &instance->events[parts[part].events]));
}

#else

static Status blame_events(Instance *instance, int i) { return (void)i, failed(instance); }
static void report_early_returns(Instance *instance) { (void)instance; }
static void forget_events(Instance *instance, int i) { (void)instance, (void)i; }
static Status start_events(Instance *instance, int i) { return (void)instance, (void)i, StatusOK; }
static Status handle_first_events(Instance *instance, int i) { return (void)instance, (void)i, StatusOK; }
static int32_t begin_change(Instance *instance, int i, int way) { return (void)instance, (void)i, (void)way, fmi2OK; }
static int32_t end_change(Instance *instance, int i, int way) { return (void)instance, (void)i, (void)way, fmi2OK; }

#endif
