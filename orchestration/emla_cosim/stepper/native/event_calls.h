/* Events of single instances, for hosts that call these one by one. */

static int32_t ask_shift(const Stepper *s, Events *e, int32_t clock, double *shift) {
    *shift = 0.0;
    announce(s, e->codes[FMI_GET_SHIFT_DECIMAL]);
    const int32_t status = (int32_t)((fmi3GetShiftDecimalTYPE *)e->functions[FMI_GET_SHIFT_DECIMAL])(
        e->component, &e->clocks[clock], 1, shift);
    return is_bad(status) ? blame_call(e, FMI_GET_SHIFT_DECIMAL, status) : NO_PROBLEM;
}

static int32_t start_periodic_clock(const Stepper *s, Events *e, int32_t k) {
    const TimedClock *timed = &e->timed[k];
    double interval = timed->interval, shift = timed->shift;
    int32_t qualifier;
    if (timed->kind == TOLD) {
        int32_t problem = ask_interval(s, e, timed->clock, &interval, &qualifier);
        if (problem == NO_PROBLEM) problem = ask_shift(s, e, timed->clock, &shift);
        if (problem != NO_PROBLEM) return problem;
    }
    if (!(interval > 0.0 && isfinite(interval))) return blame_clock(e, WRONG_INTERVAL, timed->clock, interval);
    if (!(shift >= 0.0 && isfinite(shift))) return blame_clock(e, WRONG_SHIFT, timed->clock, shift);
    e->schedule[k] = (Ticks){e->time + shift, e->time + shift, 0.0, interval};
    return NO_PROBLEM;
}

/* Find the first ticks, in initialization mode. */
static int32_t start_clocks(const Stepper *s, Events *e) {
    for (int32_t k = 0; k < e->n_timed; k++) {
        int32_t problem;
        if (is_periodic(&e->timed[k])) {
            problem = start_periodic_clock(s, e, k);
        } else {
            e->schedule[k] = (Ticks){INFINITY, INFINITY, INFINITY, INFINITY};
            problem = find_next_tick(s, e, k);
        }
        if (problem != NO_PROBLEM) return problem;
    }
    return NO_PROBLEM;
}

const size_t events_sizes[] = {sizeof(ClockedCall), sizeof(ClockSet), sizeof(TimedClock), sizeof(TriggeredClock),
                               sizeof(Events)};

int32_t events_start(Activity *activity, Events *events, double time) {
    const Stepper s = {.activity = activity};
    events->time = events->memory[PRESENT] = time;
    events->problem = NO_PROBLEM;
    const int32_t problem = start_clocks(&s, events);
    return problem == NO_PROBLEM ? get_clocked(&s, events, 1) : problem;
}

int32_t events_enter(Activity *activity, Events *events) {
    const Stepper s = {.activity = activity};
    events->time = events->memory[PRESENT]; /* also after a state of another time */
    events->problem = NO_PROBLEM;
    return switch_mode(&s, events, FMI_ENTER_EVENT_MODE);
}

int32_t events_leave(Activity *activity, Events *events) {
    const Stepper s = {.activity = activity};
    events->problem = NO_PROBLEM;
    const int32_t problem = update_until_settled(&s, events, 0.0, 0);
    return problem == NO_PROBLEM ? switch_mode(&s, events, FMI_ENTER_STEP_MODE) : problem;
}

int32_t events_step(Activity *activity, Events *events, double time, double length, int32_t has_no_way_back) {
    const Stepper s = {.activity = activity};
    if (activity != NULL) activity->time = time;
    step_with_events(&s, events, time, length, has_no_way_back);
    return events->problem;
}
