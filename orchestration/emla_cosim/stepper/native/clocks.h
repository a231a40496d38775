/* Clocks of FMI 3.0: when they tick, which ones tick together, and the variables that belong to them. */

enum { WAITS = 1, STARTS, TICKS }; /* marks of clocks in an event */

NOINLINE static int32_t blame(Events *e, int32_t problem) { return e->problem = problem; }

NOINLINE static int32_t blame_call(Events *e, int32_t call, int32_t status) {
    e->call = call;
    e->status = status;
    return blame(e, CALL_FAILED);
}

NOINLINE static int32_t blame_clock(Events *e, int32_t problem, int32_t clock, double value) {
    e->clock = clock;
    e->value = value;
    return blame(e, problem);
}

/* ---- times of ticks ---- */

static int is_periodic(const TimedClock *timed) { return timed->kind <= TOLD; }

/* Return the time of the next tick in s; infinite without one. */
static double next_tick(const Events *e) {
    double next = INFINITY;
    for (int32_t k = 0; k < e->n_timed; k++)
        if (e->schedule[k].next < next) next = e->schedule[k].next;
    return next;
}

/* Ask for the interval of a clock in s; the qualifier says what it is. */
static int32_t ask_interval(const Stepper *s, Events *e, int32_t clock, double *interval, int32_t *qualifier) {
    fmi3IntervalQualifier answer = fmi3IntervalNotYetKnown;
    *interval = 0.0;
    announce(s, e->codes[FMI_GET_INTERVAL_DECIMAL]);
    const int32_t status = (int32_t)((fmi3GetIntervalDecimalTYPE *)e->functions[FMI_GET_INTERVAL_DECIMAL])(
        e->component, &e->clocks[clock], 1, interval, &answer);
    *qualifier = (int32_t)answer;
    return is_bad(status) ? blame_call(e, FMI_GET_INTERVAL_DECIMAL, status) : NO_PROBLEM;
}

/* Find the next tick of an aperiodic clock; one that is known stays unless it has changed. */
static int32_t find_next_tick(const Stepper *s, Events *e, int32_t k) {
    const int32_t clock = e->timed[k].clock;
    double interval;
    int32_t qualifier;
    const int32_t problem = ask_interval(s, e, clock, &interval, &qualifier);
    if (problem != NO_PROBLEM || qualifier == fmi3IntervalNotYetKnown) return problem;
    if (qualifier <= fmi3IntervalUnchanged && e->schedule[k].next != INFINITY) return NO_PROBLEM;
    if (!(interval >= 0.0 && isfinite(interval))) return blame_clock(e, WRONG_INTERVAL, clock, interval);
    e->schedule[k].next = e->time + interval;
    return NO_PROBLEM;
}

/* Find the ticks after those until a time in s, in event mode after an update of discrete states. */
static int32_t advance_clocks(const Stepper *s, Events *e, double until) {
    for (int32_t k = 0; k < e->n_timed; k++) {
        const TimedClock *timed = &e->timed[k];
        Ticks *ticks = &e->schedule[k];
        const int has_ticked = ticks->next <= until;
        if (has_ticked && is_periodic(timed)) {
            ticks->count += 1.0;
            ticks->next = ticks->first + ticks->count * ticks->interval;
        } else if (has_ticked) {
            ticks->next = INFINITY;
        }
        if (timed->kind == COUNTDOWN || (has_ticked && timed->kind == CHANGING)) {
            const int32_t problem = find_next_tick(s, e, k);
            if (problem != NO_PROBLEM) return problem;
        }
    }
    return NO_PROBLEM;
}

/* Return how often a triggered clock still has to tick. */
static double count_missing_ticks(const Events *e, const TriggeredClock *triggered) {
    return rint(e->inputs[triggered->input] - e->counts[triggered->clock]);
}

static int is_any_triggered(const Events *e) {
    for (int32_t k = 0; k < e->n_triggered; k++)
        if (count_missing_ticks(e, &e->triggered[k]) > 0.0) return 1;
    return 0;
}

/* ---- ticks ---- */

static int has_mark(const Events *e, const ClockSet *clocks, unsigned char mark) {
    for (int32_t k = clocks->first; k < clocks->first + clocks->count; k++)
        if (e->listed[k] >= 0 && e->marks[e->listed[k]] == mark) return 1;
    return 0;
}

/* Mark the input clocks that are to tick at a time in s; returns their number. */
static int32_t mark_waiting(Events *e, double until, int is_triggered) {
    int32_t n = 0;
    for (int32_t k = 0; k < e->n_timed; k++) {
        unsigned char *mark = &e->marks[e->timed[k].clock];
        if (*mark == WAITS || !(e->schedule[k].next <= until)) continue;
        *mark = WAITS;
        n++;
    }
    for (int32_t k = 0; is_triggered && k < e->n_triggered; k++) {
        unsigned char *mark = &e->marks[e->triggered[k].clock];
        if (*mark == WAITS || !(count_missing_ticks(e, &e->triggered[k]) > 0.0)) continue;
        *mark = WAITS;
        n++;
    }
    return n;
}

static void start_ticking(Events *e, int32_t clock, int32_t *n) {
    if (e->marks[clock] != WAITS) return;
    if (e->needed[clock].count > 0 && !has_mark(e, &e->needed[clock], TICKS)) return;
    e->marks[clock] = STARTS;
    e->active[*n] = fmi3ClockActive;
    e->references[(*n)++] = e->clocks[clock];
}

/* Mark the waiting clocks that can tick with those that do, and list their references; returns their number. */
static int32_t mark_starting(Events *e) {
    int32_t n = 0;
    for (int32_t k = 0; k < e->n_timed; k++) start_ticking(e, e->timed[k].clock, &n);
    for (int32_t k = 0; k < e->n_triggered; k++) start_ticking(e, e->triggered[k].clock, &n);
    return n;
}

static int32_t set_clocked(const Stepper *s, Events *e, const ClockedCall *setters, int32_t n, int32_t call) {
    for (int32_t k = 0; k < n; k++) {
        if (!has_mark(e, &setters[k].clocks, STARTS)) continue;
        const int32_t status = set_converted(s, &setters[k].call, 1, e->inputs);
        if (is_bad(status)) return blame_call(e, call, status);
    }
    return NO_PROBLEM;
}

/* Activate the input clocks that start to tick, and set their inputs. */
static int32_t set_clocks(const Stepper *s, Events *e, int32_t n) {
    announce(s, e->codes[FMI_SET_CLOCK]);
    const int32_t status = (int32_t)((fmi3SetClockTYPE *)e->functions[FMI_SET_CLOCK])(e->component, e->references,
                                                                                      (size_t)n, e->active);
    if (is_bad(status)) return blame_call(e, FMI_SET_CLOCK, status);
    const int32_t problem = set_clocked(s, e, e->setters, e->n_setters, SETTING_INPUTS);
    if (problem != NO_PROBLEM) return problem;
    return set_clocked(s, e, e->hand_setters, e->n_hand_setters, SETTING_BY_HAND);
}

/* Mark the output and local clocks that tick; `n` is increased by the number of further ones. */
static int32_t find_output_ticks(const Stepper *s, Events *e, int32_t *n) {
    if (e->n_output_clocks == 0) return NO_PROBLEM;
    memset(e->active, 0, (size_t)e->n_output_clocks * sizeof *e->active);
    announce(s, e->codes[FMI_GET_CLOCK]);
    const int32_t status = (int32_t)((fmi3GetClockTYPE *)e->functions[FMI_GET_CLOCK])(
        e->component, e->clocks, (size_t)e->n_output_clocks, e->active);
    if (is_bad(status)) return blame_call(e, FMI_GET_CLOCK, status);
    for (int32_t c = 0; c < e->n_output_clocks; c++) {
        if (!e->active[c] || e->marks[c] == TICKS) continue;
        e->marks[c] = TICKS;
        ++*n;
    }
    return NO_PROBLEM;
}

/* Get the variables of clocks that tick, or all clocked variables. */
static int32_t get_clocked(const Stepper *s, Events *e, int is_all) {
    int32_t worst = fmi2OK;
    for (int32_t k = 0; k < e->n_getters; k++) {
        if (!is_all && !has_mark(e, &e->getters[k].clocks, TICKS)) continue;
        const int32_t status = get_converted(s, &e->getters[k].call, 1, e->values);
        if (badness(status) > badness(worst)) worst = status;
    }
    return is_bad(worst) ? blame_call(e, GETTING_CLOCKED_VARIABLES, worst) : NO_PROBLEM;
}

NOINLINE static int32_t blame_waiting(Events *e) {
    int32_t clock = 0;
    for (int32_t k = e->n_triggered - 1; k >= 0; k--)
        if (e->marks[e->triggered[k].clock] == WAITS) clock = e->triggered[k].clock;
    for (int32_t k = e->n_timed - 1; k >= 0; k--)
        if (e->marks[e->timed[k].clock] == WAITS) clock = e->timed[k].clock;
    return blame_clock(e, TICK_ALONE, clock, 0.0);
}

/* Tick the input clocks that are due at a time in s, find the output clocks that tick with them, and get the variables
   of all. A clock that depends on others ticks after these, at the same instant. Output clocks may be marked. */
static int32_t tick(const Stepper *s, Events *e, double until, int is_triggered) {
    int32_t waiting = mark_waiting(e, until, is_triggered), found, problem;
    do {
        const int32_t n = mark_starting(e);
        problem = n > 0 ? set_clocks(s, e, n) : NO_PROBLEM;
        for (int32_t c = 0; c < e->n_clocks; c++)
            if (e->marks[c] == STARTS) e->marks[c] = TICKS;
        found = n;
        if (problem == NO_PROBLEM) problem = find_output_ticks(s, e, &found);
        if (problem != NO_PROBLEM) return problem;
        waiting -= n;
    } while (waiting > 0 && found > 0);
    if (waiting > 0) return blame_waiting(e);
    problem = get_clocked(s, e, 0);
    if (problem != NO_PROBLEM) return problem;
    for (int32_t c = 0; c < e->n_clocks; c++)
        if (e->marks[c] == TICKS) e->counts[c] += 1.0;
    return NO_PROBLEM;
}
