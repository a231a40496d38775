/* A toy FMU of FMI 3.0 with events and clocks, for events_host.c. */
#ifndef EVENTS_TOY_H
#define EVENTS_TOY_H

enum { MOST_CLOCKS = 8, MOST_OF_A_KIND = 3, FIRST_CLOCK = 10 };

/* What the tests need to occur; without it they would prove nothing. */
enum { EARLY_RETURNS, INPUTS_PASSED, INPUT_TICKS, DEPENDENT_TICKS, OUTPUT_TICKS, FURTHER_UPDATES, VALUES_SET_BY_HAND,
       RANGE_ERRORS, N_EVENT_OCCURRENCES };
static const char *const occurrence_names[] = {"early_returns", "inputs_passed",   "input_ticks",        "dependent_ticks",
                                               "output_ticks",  "further_updates", "values_set_by_hand", "range_errors"};
static int64_t occurred[N_EVENT_OCCURRENCES];

typedef enum { INITIALIZATION_MODE, EVENT_MODE, STEP_MODE } Mode;

/* What a toy does wrong; NONE for most. */
typedef enum { NONE, BAD_STATUS, BAD_TIME, BAD_EVENT_TIME, BAD_INTERVAL, BAD_SHIFT, STUCK_UPDATES, STUCK_RETURNS,
               STUCK_CLOCK, ENDS, N_FAULTS } Wrong;

typedef struct { /* an FMU state */
    Dice dice;
    Mode mode;
    double time, next_event;
    int64_t n_calls;
    int32_t updates_left, bursts_left;
    unsigned char active[MOST_CLOCKS];
} State;

typedef struct {
    Events events;
    Activity activity;
    State state;
    Dice ways;
    Wrong wrong;
    double step, event_probability, return_probability, burst_probability;
    double inputs[3 * MOST_OF_A_KIND];
    int32_t n_inputs, status;
    void *owned[128];
    size_t n_owned;
} Toy;

static void *own(Toy *toy, size_t count, size_t size) {
    REQUIRE(toy->n_owned < sizeof toy->owned / sizeof toy->owned[0], "there are too many tables");
    return toy->owned[toy->n_owned++] = allocate(count, size);
}

/* ---- its functions --------------------------------------------------------------------- */

static fmi3Status answer(Toy *toy) {
    toy->state.n_calls++;
    return toy->wrong == BAD_STATUS && happens(&toy->state.dice, 0.02) ? (fmi3Status)toy->status : fmi3OK;
}

/* Check mode and announcement of a call. */
static void check_call(const Toy *toy, int32_t call, Mode mode) {
    REQUIRE(toy->state.mode == mode, "a call comes in a wrong mode");
    REQUIRE(toy->activity.code == 1000 + call, "another call is announced");
}

static fmi3Status enter_event_mode(fmi3Instance instance) {
    Toy *toy = instance;
    check_call(toy, FMI_ENTER_EVENT_MODE, STEP_MODE);
    REQUIRE(toy->events.has_event_mode, "event mode is not used");
    toy->state.mode = EVENT_MODE;
    toy->state.updates_left = below(&toy->state.dice, 3);
    toy->state.bursts_left = happens(&toy->state.dice, toy->burst_probability) ? between(&toy->state.dice, 1, 3) : 0;
    return answer(toy);
}

static fmi3Status enter_step_mode(fmi3Instance instance) {
    Toy *toy = instance;
    check_call(toy, FMI_ENTER_STEP_MODE, EVENT_MODE);
    toy->state.mode = STEP_MODE;
    return answer(toy);
}

static int32_t find_clock(const Toy *toy, fmi3ValueReference reference) {
    const int32_t clock = (int32_t)reference - FIRST_CLOCK;
    REQUIRE(clock >= 0 && clock < toy->events.n_clocks, "no such clock");
    return clock;
}

static int is_active(const Toy *toy, const ClockSet *clocks) {
    for (int32_t k = clocks->first; k < clocks->first + clocks->count; k++)
        if (toy->events.listed[k] >= 0 && toy->state.active[toy->events.listed[k]]) return 1;
    return 0;
}

static fmi3Status set_clock(fmi3Instance instance, const fmi3ValueReference *references, size_t n, const fmi3Clock *values) {
    Toy *toy = instance;
    unsigned char starts[MOST_CLOCKS] = {0};
    check_call(toy, FMI_SET_CLOCK, EVENT_MODE);
    REQUIRE(n > 0, "no clock is set");
    for (size_t k = 0; k < n; k++) {
        const int32_t clock = find_clock(toy, references[k]);
        const ClockSet *needed = &toy->events.needed[clock];
        REQUIRE(clock >= toy->events.n_output_clocks && values[k], "it is not an input clock that ticks");
        REQUIRE(!toy->state.active[clock] && !starts[clock], "a clock ticks twice at once");
        REQUIRE(needed->count == 0 || is_active(toy, needed), "a clock ticks before one that it depends on");
        occurred[needed->count > 0 ? DEPENDENT_TICKS : INPUT_TICKS]++;
        starts[clock] = 1;
    }
    for (int32_t c = 0; c < MOST_CLOCKS; c++) toy->state.active[c] |= starts[c];
    return answer(toy);
}

static fmi3Status get_clock(fmi3Instance instance, const fmi3ValueReference *references, size_t n, fmi3Clock *values) {
    Toy *toy = instance;
    check_call(toy, FMI_GET_CLOCK, EVENT_MODE);
    REQUIRE((int32_t)n == toy->events.n_output_clocks, "not all output clocks are asked for");
    for (size_t k = 0; k < n; k++) {
        const int32_t clock = find_clock(toy, references[k]);
        if (!toy->state.active[clock] && (toy->wrong == STUCK_CLOCK || toy->state.bursts_left > 0)) {
            toy->state.active[clock] = 1;
            toy->state.bursts_left--;
        }
        values[k] = toy->state.active[clock];
        occurred[OUTPUT_TICKS] += values[k];
    }
    return answer(toy);
}

static fmi3Status update_toy(fmi3Instance instance, fmi3Boolean *more, fmi3Boolean *ends, fmi3Boolean *nominals,
                             fmi3Boolean *values, fmi3Boolean *has_next, fmi3Float64 *next) {
    Toy *toy = instance;
    Dice *dice = &toy->state.dice;
    check_call(toy, FMI_UPDATE_DISCRETE_STATES, EVENT_MODE);
    memset(toy->state.active, 0, sizeof toy->state.active);
    *more = toy->wrong == STUCK_UPDATES || toy->state.updates_left-- > 0;
    *ends = toy->wrong == ENDS && happens(dice, 0.1);
    *nominals = *values = happens(dice, 0.5);
    *has_next = happens(dice, 0.7);
    *next = toy->wrong == BAD_EVENT_TIME ? NAN : toy->state.time + uniform(dice, 0.001, 2.0) * toy->step;
    toy->state.next_event = *has_next ? *next : INFINITY;
    occurred[FURTHER_UPDATES] += *more;
    return answer(toy);
}

static fmi3Status get_interval(fmi3Instance instance, const fmi3ValueReference *references, size_t n,
                               fmi3Float64 *intervals, fmi3IntervalQualifier *qualifiers) {
    Toy *toy = instance;
    check_call(toy, FMI_GET_INTERVAL_DECIMAL, toy->state.mode == INITIALIZATION_MODE ? INITIALIZATION_MODE : EVENT_MODE);
    REQUIRE(n == 1 && find_clock(toy, *references) >= toy->events.n_output_clocks, "not an input clock");
    *intervals = toy->wrong == BAD_INTERVAL ? -1.0 : 0.25 * between(&toy->state.dice, 1, 3);
    *qualifiers = (fmi3IntervalQualifier)below(&toy->state.dice, 3);
    return answer(toy);
}

static fmi3Status get_shift(fmi3Instance instance, const fmi3ValueReference *references, size_t n, fmi3Float64 *shifts) {
    Toy *toy = instance;
    check_call(toy, FMI_GET_SHIFT_DECIMAL, INITIALIZATION_MODE);
    REQUIRE(n == 1 && find_clock(toy, *references) >= toy->events.n_output_clocks, "not an input clock");
    *shifts = toy->wrong == BAD_SHIFT ? INFINITY : 0.25 * below(&toy->state.dice, 3);
    return answer(toy);
}

static fmi3Status step_toy(fmi3Instance instance, fmi3Float64 time, fmi3Float64 length, fmi3Boolean has_no_way_back,
                           fmi3Boolean *event, fmi3Boolean *ends, fmi3Boolean *is_early, fmi3Float64 *last) {
    Toy *toy = instance;
    Dice *dice = &toy->state.dice;
    const Events *e = &toy->events;
    check_call(toy, FMI_DO_STEP, STEP_MODE);
    REQUIRE(fabs(time - toy->state.time) < 1e-8 && length > 0.0 && !has_no_way_back, "the step is wrong");
    REQUIRE(!e->varies_step || time + length < toy->state.next_event + 1e-8, "the step passes an event");
    REQUIRE(time + length < next_tick(e) + 1e-8, "the step passes a tick");
    *event = happens(dice, toy->event_probability);
    *ends = toy->wrong == ENDS && happens(dice, 0.05);
    *is_early = toy->wrong == STUCK_RETURNS || happens(dice, toy->return_probability);
    *last = time + (*is_early ? uniform(dice, 0.1, 0.9) * length : length);
    if (toy->wrong == STUCK_RETURNS) *last = time;
    if (toy->wrong == BAD_TIME && *is_early) *last = happens(dice, 0.5) ? NAN : time + 2.0 * length;
    occurred[EARLY_RETURNS] += *is_early;
    toy->state.time = *last;
    return answer(toy);
}

/* Value references tell which table a call is in, and the position. */
enum { DISCRETE = 100, CLOCKED = 200, BY_HAND = 300, GOT = 400 };

static const ClockSet *clocks_of(const Toy *toy, uint32_t reference) {
    const ClockedCall *calls = reference < BY_HAND ? toy->events.setters
                               : reference < GOT   ? toy->events.hand_setters
                                                   : toy->events.getters;
    return &calls[reference % 100].clocks;
}

static fmi3Status exchange_values(Toy *toy, const fmi3ValueReference *references, size_t n, size_t n_values) {
    REQUIRE(n == 1 && n_values == 1 && toy->activity.code == (int64_t)*references, "wrong arguments");
    if (*references < CLOCKED) REQUIRE(toy->state.mode == EVENT_MODE, "discrete inputs change in event mode");
    else if (toy->state.mode != INITIALIZATION_MODE)
        REQUIRE(is_active(toy, clocks_of(toy, *references)), "none of the clocks of a variable ticks");
    occurred[INPUTS_PASSED] += *references < CLOCKED;
    occurred[VALUES_SET_BY_HAND] += *references >= BY_HAND && *references < GOT;
    return answer(toy);
}

static fmi3Status exchange_double(fmi3Instance instance, const fmi3ValueReference *references, size_t n, void *values,
                                  size_t n_values) {
    Toy *toy = instance;
    if (*references >= GOT) *(double *)values = uniform(&toy->state.dice, -1.0, 1.0);
    return exchange_values(toy, references, n, n_values);
}

static fmi3Status exchange_byte(fmi3Instance instance, const fmi3ValueReference *references, size_t n, void *values,
                                size_t n_values) {
    Toy *toy = instance;
    if (*references >= GOT) *(int8_t *)values = (int8_t)between(&toy->state.dice, -100, 100);
    return exchange_values(toy, references, n, n_values);
}

/* ---- its tables ------------------------------------------------------------------------ */

/* Fill in a call for one value, at a position in the vector; without one, -1, it is not converted. */
static void draw_call(Toy *toy, Call *call, uint32_t reference, int32_t item) {
    const int is_byte = happens(&toy->ways, 0.3);
    uint32_t *references = own(toy, 1, sizeof *references);
    int32_t *items = own(toy, 2, sizeof *items);
    memset(call, 0, sizeof *call);
    *references = reference;
    items[0] = item, items[1] = 0;
    call->function = is_byte ? (Function)exchange_byte : (Function)exchange_double;
    call->component = toy;
    call->references = references, call->n_references = 1;
    call->values = own(toy, 1, is_byte ? 1 : sizeof(double)), call->n_values = 1;
    call->items = items, call->places = items + 1, call->n_items = item >= 0;
    call->type = is_byte ? TYPE_INT8 : TYPE_FLOAT64;
    call->code = (int64_t)reference;
    call->is_version_3 = 1;
}

static ClockSet draw_clocks(Toy *toy, int32_t *listed, int32_t *n, int32_t fewest) {
    const ClockSet set = {*n, between(&toy->ways, fewest, 2)};
    for (int32_t k = 0; k < set.count; k++)
        listed[(*n)++] = happens(&toy->ways, 0.1) ? -1 : below(&toy->ways, toy->events.n_clocks);
    return set;
}

static ClockedCall *draw_calls(Toy *toy, int32_t *n, int32_t *listed, int32_t *n_listed, uint32_t first, int has_items) {
    *n = toy->events.n_clocks > 0 ? below(&toy->ways, MOST_OF_A_KIND + 1) : 0;
    ClockedCall *calls = own(toy, (size_t)*n, sizeof *calls);
    for (int32_t k = 0; k < *n; k++) {
        const int32_t item = first == GOT ? k : has_items ? toy->n_inputs++ : -1;
        draw_call(toy, &calls[k].call, first + (uint32_t)k, item);
        calls[k].clocks = draw_clocks(toy, listed, n_listed, 1);
    }
    return calls;
}

static void draw_clocked(Toy *toy) {
    Events *e = &toy->events;
    int32_t *listed = own(toy, 64, sizeof *listed), n = 0;
    ClockSet *needed = own(toy, (size_t)e->n_clocks, sizeof *needed);
    const int can_depend = happens(&toy->ways, 0.3);
    for (int32_t c = 0; c < e->n_clocks; c++) {
        needed[c] = (ClockSet){0, 0};
        if (can_depend && c >= e->n_output_clocks && happens(&toy->ways, 0.5))
            needed[c] = draw_clocks(toy, listed, &n, 1);
    }
    e->listed = listed;
    e->needed = needed;
    e->setters = draw_calls(toy, &e->n_setters, listed, &n, CLOCKED, 1);
    e->hand_setters = draw_calls(toy, &e->n_hand_setters, listed, &n, BY_HAND, 0);
    e->getters = draw_calls(toy, &e->n_getters, listed, &n, GOT, 1);
}

static void draw_clock_tables(Toy *toy) {
    Events *e = &toy->events;
    TimedClock *timed = own(toy, (size_t)e->n_timed, sizeof *timed);
    TriggeredClock *triggered = own(toy, (size_t)e->n_triggered, sizeof *triggered);
    fmi3ValueReference *clocks = own(toy, (size_t)e->n_clocks, sizeof *clocks);
    for (int32_t k = 0; k < e->n_timed; k++) {
        timed[k].interval = toy->wrong == BAD_INTERVAL ? NAN : 0.25 * between(&toy->ways, 1, 2);
        timed[k].shift = toy->wrong == BAD_SHIFT ? -0.25 : 0.25 * below(&toy->ways, 2);
        timed[k].clock = e->n_output_clocks + k;
        timed[k].kind = below(&toy->ways, 4);
    }
    for (int32_t k = 0; k < e->n_triggered; k++)
        triggered[k] = (TriggeredClock){e->n_output_clocks + e->n_timed + k, toy->n_inputs++};
    for (int32_t c = 0; c < e->n_clocks; c++) clocks[c] = FIRST_CLOCK + (uint32_t)c;
    e->timed = timed;
    e->triggered = triggered;
    e->clocks = clocks;
    e->marks = own(toy, (size_t)e->n_clocks, 1);
    e->active = own(toy, (size_t)e->n_clocks, sizeof(fmi3Boolean));
    e->references = own(toy, (size_t)e->n_clocks, sizeof *e->references);
}

static void draw_discrete(Toy *toy) {
    Events *e = &toy->events;
    e->n_discrete = e->n_discrete_setters = e->has_event_mode ? below(&toy->ways, MOST_OF_A_KIND + 1) : 0;
    int32_t *discrete = own(toy, (size_t)e->n_discrete, sizeof *discrete);
    Call *setters = own(toy, (size_t)e->n_discrete, sizeof *setters);
    for (int32_t k = 0; k < e->n_discrete; k++) {
        discrete[k] = toy->n_inputs++;
        draw_call(toy, &setters[k], DISCRETE + (uint32_t)k, discrete[k]);
    }
    e->discrete = discrete;
    e->discrete_setters = setters;
}

static void build_memory(Events *e, Toy *toy) {
    e->n_memory = FIRST_PASSED + e->n_discrete + 4 * e->n_timed + e->n_getters + e->n_clocks;
    e->memory = own(toy, (size_t)e->n_memory, sizeof(double));
    e->memory[NEXT_EVENT] = INFINITY;
    e->passed = e->memory + FIRST_PASSED;
    e->schedule = (Ticks *)(e->passed + e->n_discrete);
    e->values = (double *)(e->schedule + e->n_timed);
    e->counts = e->values + e->n_getters;
    for (int32_t c = 0; c < e->n_clocks; c++) e->counts[c] = 0.0;
}

static Toy *build_toy(uint64_t seed) {
    static const Function functions[] = {
        (Function)step_toy,  (Function)enter_event_mode, (Function)enter_step_mode, (Function)update_toy,
        (Function)set_clock, (Function)get_clock,        (Function)get_interval,    (Function)get_shift};
    Toy *toy = calloc(1, sizeof *toy);
    if (toy == NULL) abort();
    Events *e = &toy->events;
    toy->ways.state = seed;
    toy->state.dice.state = ~seed;
    toy->state.next_event = INFINITY;
    toy->wrong = happens(&toy->ways, 0.5) ? NONE : (Wrong)below(&toy->ways, N_FAULTS);
    toy->status = happens(&toy->ways, 0.5) ? fmi3Discard : between(&toy->ways, fmi3Error, fmi3Fatal + 2);
    toy->step = 0.125 * between(&toy->ways, 1, 4);
    toy->event_probability = 0.5 * below(&toy->ways, 2);
    toy->return_probability = 0.5 * below(&toy->ways, 2);
    toy->burst_probability = 0.5 * below(&toy->ways, 2);
    e->component = toy;
    memcpy(e->functions, functions, sizeof functions);
    for (int32_t call = 0; call < N_EVENT_FUNCTIONS; call++) e->codes[call] = 1000 + call;
    e->has_event_mode = happens(&toy->ways, 0.9);
    e->may_return_early = happens(&toy->ways, 0.8);
    e->varies_step = happens(&toy->ways, 0.8);
    e->n_output_clocks = e->has_event_mode ? below(&toy->ways, MOST_OF_A_KIND) : 0;
    e->n_timed = e->has_event_mode ? below(&toy->ways, MOST_OF_A_KIND + 1) : 0;
    e->n_triggered = e->has_event_mode ? below(&toy->ways, MOST_OF_A_KIND) : 0;
    e->n_clocks = e->n_output_clocks + e->n_timed + e->n_triggered;
    e->inputs = toy->inputs;
    e->first_return = NAN;
    draw_discrete(toy);
    draw_clock_tables(toy);
    draw_clocked(toy);
    build_memory(e, toy);
    REQUIRE(toy->n_inputs <= (int32_t)(sizeof toy->inputs / sizeof toy->inputs[0]), "there are too many inputs");
    return toy;
}

static void free_toy(Toy *toy) {
    for (size_t n = 0; n < toy->n_owned; n++) free(toy->owned[n]);
    free(toy);
}

/* ---- what the host does with it -------------------------------------------------------- */

/* Change inputs, and let the clocks tick that drive triggered ones. */
static void change_inputs(Toy *toy) {
    for (int32_t j = 0; j < toy->n_inputs; j++)
        if (happens(&toy->ways, 0.3)) toy->inputs[j] = uniform(&toy->ways, -100.0, 100.0);
    if (happens(&toy->ways, 0.02) && toy->n_inputs > 0)
        toy->inputs[below(&toy->ways, toy->n_inputs)] = happens(&toy->ways, 0.5) ? NAN : 200.0;
    for (int32_t k = 0; k < toy->events.n_triggered; k++) {
        const double ticks = happens(&toy->ways, 0.01) ? MOST_UPDATES : below(&toy->ways, 3);
        toy->inputs[toy->events.triggered[k].input] = toy->events.counts[toy->events.triggered[k].clock] + ticks;
    }
}

static int has_unequal_inputs(const Toy *toy) {
    for (int32_t k = 0; k < toy->events.n_discrete; k++)
        if (isnan(toy->inputs[toy->events.discrete[k]])) return 1;
    return 0;
}

/* Check what the start of the clocks left, still in initialization mode. */
static void check_start(const Toy *toy, int32_t problem) {
    const Events *e = &toy->events;
    REQUIRE(toy->state.mode == INITIALIZATION_MODE, "it has left initialization mode");
    if (problem != NO_PROBLEM) return;
    for (int32_t k = 0; k < e->n_timed; k++)
        REQUIRE(e->schedule[k].next >= toy->state.time, "the first tick is before the start");
    for (int32_t k = 0; k < e->n_getters; k++) REQUIRE(!isnan(e->values[k]), "a clocked variable is not read");
}

#endif
