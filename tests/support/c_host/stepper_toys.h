/* What stepper_host.c stands on besides fuzz_basics.h: toy FMUs of both versions of FMI.
 *
 * A toy is a contraction with feedthrough. It checks the arguments of all calls, counts the calls of each kind,
 * and fails in those that a list of faults names. These counts are no part of its FMU state, so that a repeated
 * step may succeed.
 */
#ifndef STEPPER_TOYS_H
#define STEPPER_TOYS_H

enum { MOST_INSTANCES = 8, MOST_VALUES = 5, MOST_FAULTS = 3 }; /* values: inputs or outputs of an instance */

/* What the tests need to occur; without it they would prove nothing. */
enum {
    STATES_RESTORED,
    HALVES_THAT_HELPED,
    VALUES_OUT_OF_RANGE,
    ARRAYS_SET,
    DERIVATIVES_SET,
    STEPS_OF_SEVERAL,
    WISHES_TO_END,
    TRIALS_ACCEPTED,
    TRIALS_REJECTED,
    EVENTS_MET,
    LEAPS,
    TRIALS_LATE,
    TRIALS_INTERRUPTED,
    N_OCCURRENCES
};
static const char *const occurrence_names[] = {
    "states_restored", "halves_that_helped", "values_out_of_range", "arrays_set",
    "derivatives_set", "steps_of_several",   "wishes_to_end",
    "trials_accepted", "trials_rejected",    "events_met",          "leaps",
    "trials_late",     "trials_interrupted"};
static int64_t occurred[N_OCCURRENCES];

/* ---- memory ---------------------------------------------------------------------------- */

static int is_unused(double value) {
    unsigned char bytes[sizeof value];
    memcpy(bytes, &value, sizeof value);
    for (size_t b = 0; b < sizeof value; b++)
        if (bytes[b] != 0xFF) return 0;
    return 1;
}

static int is_same(double a, double b) { return a == b || (isnan(a) && isnan(b)); }

/* ---- values of all types --------------------------------------------------------------- */

#define EACH_WHOLE_TYPE(X)                       \
    X(TYPE_INT8, int8_t, INT8_MIN, INT8_MAX)     \
    X(TYPE_UINT8, uint8_t, 0, UINT8_MAX)         \
    X(TYPE_INT16, int16_t, INT16_MIN, INT16_MAX) \
    X(TYPE_UINT16, uint16_t, 0, UINT16_MAX)      \
    X(TYPE_INT32, int32_t, INT32_MIN, INT32_MAX) \
    X(TYPE_UINT32, uint32_t, 0, UINT32_MAX)      \
    X(TYPE_INT64, int64_t, INT64_MIN, INT64_MAX) \
    X(TYPE_UINT64, uint64_t, 0, UINT64_MAX)

static const size_t size_of_type[] = {8, 4, 1, 1, 2, 2, 4, 4, 8, 8, sizeof(fmi3Boolean), sizeof(fmi2Boolean)};

static int is_whole(int32_t type) { return type >= TYPE_INT8 && type <= TYPE_UINT64; }

static double smallest_of(int32_t type) {
    switch (type) {
#define SMALLEST(NAME, c_type, low, high) case NAME: return (double)(low);
        EACH_WHOLE_TYPE(SMALLEST)
#undef SMALLEST
        default: return 0.0;
    }
}

static double largest_of(int32_t type) {
    switch (type) {
#define LARGEST(NAME, c_type, low, high) case NAME: return (double)(high);
        EACH_WHOLE_TYPE(LARGEST)
#undef LARGEST
        default: return 1.0;
    }
}

/* Return one of the values of a call as a number, as the stepper must read it. */
static double take_number(const void *values, int32_t type, int32_t k) {
    switch (type) {
#define TAKE_WHOLE(NAME, c_type, low, high) case NAME: return (double)((const c_type *)values)[k];
        EACH_WHOLE_TYPE(TAKE_WHOLE)
#undef TAKE_WHOLE
        case TYPE_FLOAT64: return ((const double *)values)[k];
        case TYPE_FLOAT32: return (double)((const float *)values)[k];
        case TYPE_BOOLEAN: return ((const unsigned char *)values)[k] != 0;
        default: return ((const fmi2Boolean *)values)[k] != 0;
    }
}

/* Put a number into the values of a call, as near as its type allows. */
static void put_number(void *values, int32_t type, int32_t k, double number) {
    const double whole = isnan(number) ? 0.0 : number;
    switch (type) {
#define PUT_WHOLE(NAME, c_type, low, high)                          \
    case NAME: {                                                    \
        c_type *place = (c_type *)values + k;                       \
        *place = high;                                              \
        if (whole <= (double)(low)) *place = low;                   \
        else if (whole < (double)(high)) *place = (c_type)whole;    \
        return;                                                     \
    }
        EACH_WHOLE_TYPE(PUT_WHOLE)
#undef PUT_WHOLE
        case TYPE_FLOAT64: ((double *)values)[k] = number; return;
        case TYPE_FLOAT32: ((float *)values)[k] = (float)number; return;
        /* an FMU may have another idea of true than 1 */
        case TYPE_BOOLEAN: ((unsigned char *)values)[k] = (unsigned char)(whole > 0.0 ? 1 + k : 0); return;
        default: ((fmi2Boolean *)values)[k] = whole > 0.0 ? 1 + k : 0;
    }
}

/* Whether a toy got what the stepper should have made of an input. */
static int is_converted(int32_t type, double number, double input) {
    if (is_whole(type)) return fabs(number - input) <= 0.5 || fabs(number - input) <= 1e-15 * fabs(input);
    if (type == TYPE_FLOAT64) return is_same(number, input);
    if (type == TYPE_FLOAT32) return is_same(number, (double)(float)input);
    return (number != 0.0) == !(fabs(input) <= 0.5);
}

/* ---- systems and toys ------------------------------------------------------------------ */

/* What calls are counted for, and what fails. */
typedef enum { SETTING, GETTING, OBSERVING, DERIVING, STEPPING, SAVING, RESTORING, ASKING, N_OCCASIONS } Occasion;

typedef enum {
    GIVE_STATUS,
    GIVE_NAN, /* for values that are got */
    GIVE_INFINITY,
    GIVE_HUGE,
    NEED_EVENT, /* for steps; these three only for FMI 3.0 or with a status */
    WANT_END,
    END_EARLY,
    REFUSE_LONG, /* discards long steps: halves help */
    RAISE_STOP
} Effect;

typedef struct {
    int64_t first, last; /* calls of this kind, from 1 */
    Occasion occasion;
    Effect effect;
    int32_t instance, status;
} Fault;

/* What an FMU state has. Each step gives another id, so that equal ids mean the same state. */
typedef struct {
    int64_t id;
    double time, x;
    double inputs[MOST_VALUES], slopes[MOST_VALUES];
} State;

/* What the stepper knew of an instance when it saved its state. */
typedef struct {
    int64_t id;
    double now[MOST_VALUES], previous[MOST_VALUES], at, before;
} Knowledge;

typedef struct System System;

typedef struct {
    System *system;
    int32_t instance;
    int32_t wants_end; /* for FMI 2.0: what it says if it is asked */
    int32_t has_ended; /* whether it must do no further step */
    State state;
    double decay, gain, feedthrough, restlessness, scale; /* of the model */
    Knowledge knowledge;
    double step_time, step_length; /* of its last step */
    int64_t n_calls[N_OCCASIONS];
    uint32_t bad_answers; /* bits of the statuses that it has given */
} Toy;

struct System {
    Stepper stepper;
    Toy *toys;
    Fault faults[MOST_FAULTS];
    Activity *activity;
    int32_t *stop;
    SavedState *states;       /* the places that groups save states in */
    SavedState *trial_states; /* and error control */
    double *memory;           /* all that steps change, if errors are controlled */
    int32_t n_instances, n_faults, n_stores, n_memory, is_controlled;
    int32_t is_lost;    /* a run has failed: times and values are anything from now on */
    const Control *control; /* of its errors; NULL without */
    int32_t has_halves; /* whether a step was shorter than usual */
    int32_t must_fail;  /* whether an FMU answered what no shorter step can help against */
    int64_t first, count, every; /* steps, and the distance of rows */
    int64_t n_ids, n_saved, n_ticks;
    double step, tick_probability;
    Dice dice, ways, ticks;
    int64_t second; /* the wall time */
    void *owned[2048]; /* all tables */
    size_t n_owned;
};

static System *present_system; /* whose steps take wall time */

static time_t read_wall_clock(time_t *result) {
    System *system = present_system;
    if (happens(&system->ticks, system->tick_probability)) {
        system->second++;
        system->n_ticks++;
    }
    if (result != NULL) *result = (time_t)system->second;
    return (time_t)system->second;
}

/* ---- arguments of all calls ------------------------------------------------------------ */

/* Value references tell which call an array belongs to, and the position in it. */
enum { PER_OCCASION = 10000, PER_CALL = 100 };

/* Codes in Activity. */
enum { INSTANCE_CODE = 1000, CODE_OF_CALLS = 100 };

static const FmuInstance *instance_of(const Toy *toy) { return &toy->system->stepper.instances[toy->instance]; }

static void check_activity(const Toy *toy, int64_t code) {
    const Activity *activity = toy->system->activity;
    REQUIRE(activity == NULL || activity->code == code, "another call is announced");
}

/* The code of a call that has no values. */
static int64_t code_of(const Toy *toy, Occasion occasion) {
    return INSTANCE_CODE * (toy->instance + 1) + (int64_t)occasion;
}

/* Return which call an FMU function was called for, after a look at its arguments. */
static const Call *find_call(const Toy *toy, const uint32_t *references, size_t n, const void *values,
                             size_t n_values, int32_t type, int32_t is_version_3) {
    REQUIRE(n > 0, "a call has no value references");
    const Stepper *s = &toy->system->stepper;
    const FmuInstance *instance = instance_of(toy);
    const int32_t occasion = (int32_t)references[0] / PER_OCCASION;
    const int32_t number = (int32_t)references[0] % PER_OCCASION / PER_CALL;
    const Call *calls = occasion == SETTING   ? instance->setters
                        : occasion == GETTING ? instance->getters
                                              : s->observers;
    const int32_t n_calls = occasion == SETTING   ? instance->n_setters
                            : occasion == GETTING ? instance->n_getters
                                                  : s->n_observers;
    REQUIRE(number < n_calls, "no such call");
    const Call *call = &calls[number];
    REQUIRE(call->component == toy && call->instance == toy->instance, "the call is for another instance");
    REQUIRE(call->is_version_3 == is_version_3 && call->type == type, "the call is for another type");
    REQUIRE(n == (size_t)call->n_references, "the number of value references is wrong");
    for (size_t r = 0; r < n; r++)
        REQUIRE(references[r] == references[0] + r, "value references are wrong");
    REQUIRE(values == call->values, "the values are elsewhere");
    REQUIRE(!is_version_3 || n_values == (size_t)call->n_values, "the number of values is wrong");
    check_activity(toy, call->code);
    return call;
}

static Occasion occasion_of(const uint32_t *references) { return (Occasion)(references[0] / PER_OCCASION); }

/* ---- faults ---------------------------------------------------------------------------- */

static uint32_t bit_of(int32_t status) { return status < 0 ? 1u : status > 30 ? 2u : 1u << status; }

/* Count a call; returns its fault, if any. */
static const Fault *next_fault(Toy *toy, Occasion occasion) {
    System *system = toy->system;
    const Fault *active = NULL;
    const int64_t call = ++toy->n_calls[occasion];
    for (int32_t f = 0; f < system->n_faults; f++) {
        const Fault *fault = &system->faults[f];
        if (fault->instance != toy->instance || fault->occasion != occasion) continue;
        if (call < fault->first || call > fault->last) continue;
        if (fault->effect != RAISE_STOP) active = fault;
        else if (system->stop != NULL) *system->stop = 1;
    }
    return active;
}

static int32_t answer_badly(Toy *toy, Occasion occasion, int32_t status) {
    toy->bad_answers |= bit_of(status);
    if (occasion != STEPPING || status != fmi2Discard) toy->system->must_fail = 1;
    return status;
}

/* The status of a call: that of its fault, or OK, or a warning. */
static int32_t answer(Toy *toy, Occasion occasion, const Fault *fault) {
    if (fault != NULL && fault->effect == GIVE_STATUS) return answer_badly(toy, occasion, fault->status);
    return toy->n_calls[occasion] % 7 == 3 ? fmi2Warning : fmi2OK;
}

/* ---- values ---------------------------------------------------------------------------- */

static int32_t set_toy(Toy *toy, const uint32_t *references, size_t n, const void *values, size_t n_values,
                       int32_t type, int32_t is_version_3) {
    const Call *call = find_call(toy, references, n, values, n_values, type, is_version_3);
    const Stepper *s = &toy->system->stepper;
    const FmuInstance *instance = instance_of(toy);
    const Fault *fault = next_fault(toy, SETTING);
    int32_t is_set[64] = {0};
    for (int32_t k = 0; k < call->n_items; k++) {
        const int32_t item = call->items[k], place = call->places[k];
        const double number = take_number(values, type, place);
        REQUIRE(is_converted(type, number, s->input_values[item]), "an input is converted in a wrong way");
        toy->state.inputs[item - instance->first_input] = number;
        is_set[place] = 1;
    }
    if (call->n_items == 0) { /* the numbers themselves */
        const ptrdiff_t start = (const double *)values - &s->input_values[instance->first_input];
        for (int32_t k = 0; k < call->n_values; k++) toy->state.inputs[start + k] = ((const double *)values)[k];
        return answer(toy, SETTING, fault);
    }
    for (int32_t k = 0; k < call->n_values; k++) /* the rest of an array keeps its start values */
        REQUIRE(is_set[k] || take_number(values, type, k) == 1.0, "an element without connection is changed");
    if (call->n_values > call->n_items) occurred[ARRAYS_SET]++;
    return answer(toy, SETTING, fault);
}

static double output_of(const Toy *toy, int32_t k) {
    double sum = 0.0;
    for (int32_t j = 0; j < instance_of(toy)->n_inputs; j++) {
        const double input = toy->state.inputs[j];
        sum += input / (1.0 + fabs(input));
    }
    const double noise = toy->restlessness * (double)(toy->n_calls[STEPPING] % 5);
    return toy->scale * (toy->state.x + toy->feedthrough * sum + noise) * (1.0 + 0.25 * k);
}

static double spoil(double value, const Fault *fault) {
    if (fault == NULL) return value;
    switch (fault->effect) {
        case GIVE_NAN: return (double)NAN;
        case GIVE_INFINITY: return (double)-INFINITY;
        case GIVE_HUGE: return 1e300;
        default: return value;
    }
}

static int32_t get_toy(Toy *toy, const uint32_t *references, size_t n, void *values, size_t n_values, int32_t type,
                       int32_t is_version_3) {
    const Call *call = find_call(toy, references, n, values, n_values, type, is_version_3);
    const Occasion occasion = occasion_of(references);
    const Fault *fault = next_fault(toy, occasion);
    const int32_t first = (int32_t)references[0] % PER_OCCASION / PER_CALL, n_all = (int32_t)call->n_values;
    for (int32_t k = 0; k < n_all; k++) {
        const double value = output_of(toy, first + k);
        put_number(values, type, k, k == n_all - 1 || toy->instance % 2 ? spoil(value, fault) : value);
    }
    return answer(toy, occasion, fault);
}

static int32_t derive_toy(Toy *toy, const uint32_t *references, size_t n, const fmi2Integer *orders,
                          const double *values) {
    const FmuInstance *instance = instance_of(toy);
    const Fault *fault = next_fault(toy, DERIVING);
    check_activity(toy, code_of(toy, DERIVING));
    REQUIRE(instance->mode == LINE, "the instance does not interpolate");
    REQUIRE(n == (size_t)instance->n_inputs, "the number of derivatives is wrong");
    REQUIRE(values == &toy->system->stepper.derivatives[instance->first_input], "the derivatives are elsewhere");
    for (size_t k = 0; k < n; k++) {
        REQUIRE(references[k] == k && orders[k] == 1, "value references or orders of derivatives are wrong");
        toy->state.slopes[k] = values[k];
    }
    occurred[DERIVATIVES_SET]++;
    return answer(toy, DERIVING, fault);
}

/* ---- steps ----------------------------------------------------------------------------- */

static void check_step(const Toy *toy, double time, double length, int has_no_way_back) {
    const System *system = toy->system;
    check_activity(toy, code_of(toy, STEPPING));
    REQUIRE(system->activity == NULL || system->activity->time == time, "another time is announced");
    REQUIRE(has_no_way_back == instance_of(toy)->has_no_way_back, "whether there is a way back is wrong");
    REQUIRE(length > 0.0, "a step has no length");
    if (system->is_lost) return;
    REQUIRE(!toy->has_ended, "an instance that wants the end does another step");
    /* also after a step that another instance discarded, so that a missing restoration shows */
    const double gap = fabs(time - toy->state.time);
    REQUIRE(gap <= 1e-9 * (1.0 + fabs(time)), "the step does not begin where the last ended");
}

static void advance_toy(Toy *toy, double time, double length) {
    double rate = -toy->decay * toy->state.x;
    for (int32_t j = 0; j < instance_of(toy)->n_inputs; j++) {
        const double input = toy->state.inputs[j] + 0.5 * length * toy->state.slopes[j];
        rate += toy->gain * input / (1.0 + fabs(input));
    }
    toy->state.x += length * rate;
    toy->state.time = time + length;
}

/* Do a step; returns its fault, if any, and in `status` the answer of the FMU. */
static const Fault *step_toy(Toy *toy, double time, double length, int has_no_way_back, int32_t *status) {
    System *system = toy->system;
    check_step(toy, time, length, has_no_way_back);
    const Fault *fault = next_fault(toy, STEPPING);
    const int is_refused = fault != NULL && fault->effect == REFUSE_LONG && length > 0.6 * system->step;
    toy->step_time = time;
    toy->step_length = length;
    toy->state.id = ++system->n_ids;
    if (length < 0.9 * system->step) system->has_halves = 1;
    if (length > 1.1 * system->step) occurred[STEPS_OF_SEVERAL]++;
    *status = is_refused ? answer_badly(toy, STEPPING, fmi2Discard) : answer(toy, STEPPING, fault);
    if (is_refused || (fault != NULL && fault->effect == GIVE_STATUS))
        advance_toy(toy, time, 0.3 * length); /* where a discarded step ends is up to the FMU */
    else
        advance_toy(toy, time, length);
    return fault;
}

static fmi2Status do_step_of_toy_2(fmi2Component component, double time, double length, fmi2Boolean no_way_back) {
    Toy *toy = component;
    int32_t status;
    const Fault *fault = step_toy(toy, time, length, no_way_back, &status);
    toy->wants_end = fault != NULL && fault->effect == WANT_END;
    toy->has_ended = toy->wants_end && instance_of(toy)->get_status != NULL;
    return (fmi2Status)(toy->wants_end ? answer_badly(toy, STEPPING, fmi2Discard) : status);
}

static fmi3Status do_step_of_toy_3(fmi3Instance instance, double time, double length, fmi3Boolean no_way_back,
                                   fmi3Boolean *needs_event, fmi3Boolean *terminates, fmi3Boolean *is_early,
                                   double *reached) {
    Toy *toy = instance;
    int32_t status;
    const Fault *fault = step_toy(toy, time, length, no_way_back, &status);
    const Effect effect = fault == NULL ? GIVE_STATUS : fault->effect;
    REQUIRE(!*needs_event && !*terminates && !*is_early, "flags of an earlier step are left");
    *needs_event = effect == NEED_EVENT;
    *terminates = effect == WANT_END;
    *is_early = effect == END_EARLY;
    *reached = time + length;
    if (effect == WANT_END) {
        answer_badly(toy, STEPPING, fmi2Discard); /* what the stepper makes of it */
        toy->has_ended = 1;
        occurred[WISHES_TO_END]++;
    }
    if (effect == NEED_EVENT || effect == END_EARLY) answer_badly(toy, STEPPING, fmi2Error);
    return (fmi3Status)status;
}

static fmi2Status get_status_of_toy(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
    Toy *toy = component;
    const Fault *fault = next_fault(toy, ASKING);
    check_activity(toy, code_of(toy, ASKING));
    REQUIRE(kind == fmi2Terminated, "another status is asked for");
    *value = toy->wants_end;
    if (fault != NULL) { /* not a reason to fail: the answer is ignored */
        toy->has_ended = 0;
        return (fmi2Status)fault->status;
    }
    occurred[WISHES_TO_END] += toy->wants_end;
    return fmi2OK;
}

/* ---- states ---------------------------------------------------------------------------- */

/* A state that is saved again is one that was restored: the stepper must then know the same as before. */
static void check_knowledge(Toy *toy) {
    const Stepper *s = &toy->system->stepper;
    const FmuInstance *instance = instance_of(toy);
    Knowledge present;
    memset(&present, 0, sizeof present);
    present.id = toy->state.id;
    present.at = s->at[toy->instance];
    present.before = s->before[toy->instance];
    for (int32_t k = 0; k < instance->n_outputs; k++) {
        present.now[k] = s->stores[SIGNALS][instance->first_output + k];
        present.previous[k] = s->stores[PREVIOUS][instance->first_output + k];
    }
    const Control *c = toy->system->control;
    const int is_coarse = c != NULL && c->coarse_time == c->time; /* a whole step begins with other signals */
    if (present.id == toy->knowledge.id && !toy->system->is_lost && !is_coarse)
        REQUIRE(memcmp(&present, &toy->knowledge, sizeof present) == 0, "signals or times are not restored");
    toy->knowledge = present;
}

static int32_t save_toy(Toy *toy, void **state) {
    const Fault *fault = next_fault(toy, SAVING);
    check_activity(toy, code_of(toy, SAVING));
    const int is_of_trial = state == &toy->system->trial_states[toy->instance].state;
    const int is_of_group = state == &toy->system->states[toy->instance].state;
    REQUIRE(is_of_trial || is_of_group, "the place of the state is wrong");
    if (!is_of_trial) check_knowledge(toy); /* stepper_trials.h looks at all memory */
    if (fault != NULL && toy->instance % 2) return answer(toy, SAVING, fault); /* with or without a state */
    if (*state == NULL) {
        *state = allocate(1, sizeof(State));
        toy->system->n_saved++;
    }
    memcpy(*state, &toy->state, sizeof(State));
    return answer(toy, SAVING, fault);
}

static int32_t restore_toy(Toy *toy, void *state) {
    const Fault *fault = next_fault(toy, RESTORING);
    check_activity(toy, code_of(toy, RESTORING));
    const System *system = toy->system;
    const int is_of_group = state == system->states[toy->instance].state;
    const int is_of_trial = state == system->trial_states[toy->instance].state;
    REQUIRE(state != NULL && (is_of_group || is_of_trial), "the state is another one");
    memcpy(&toy->state, state, sizeof(State));
    occurred[STATES_RESTORED]++;
    return answer(toy, RESTORING, fault);
}

static void free_state_of_toy(Toy *toy, void **state) {
    toy->system->n_saved--;
    free(*state);
    *state = NULL;
}

/* ---- FMI functions --------------------------------------------------------------------- */

#define DEFINE_2(NAME, c_type)                                                                                     \
    static fmi2Status get_##NAME##_2(fmi2Component c, const fmi2ValueReference r[], size_t n, c_type values[]) {   \
        return (fmi2Status)get_toy(c, r, n, values, n, NAME, 0);                                                   \
    }                                                                                                              \
    static fmi2Status set_##NAME##_2(fmi2Component c, const fmi2ValueReference r[], size_t n,                      \
                                     const c_type values[]) {                                                      \
        return (fmi2Status)set_toy(c, r, n, values, n, NAME, 0);                                                   \
    }
DEFINE_2(TYPE_FLOAT64, fmi2Real)
DEFINE_2(TYPE_INT32, fmi2Integer)
DEFINE_2(TYPE_BOOLEAN_2, fmi2Boolean)

#define EACH_TYPE_3(X)                                                                                        \
    X(TYPE_FLOAT64, fmi3Float64) X(TYPE_FLOAT32, fmi3Float32) X(TYPE_INT8, fmi3Int8) X(TYPE_UINT8, fmi3UInt8) \
    X(TYPE_INT16, fmi3Int16) X(TYPE_UINT16, fmi3UInt16) X(TYPE_INT32, fmi3Int32) X(TYPE_UINT32, fmi3UInt32)   \
    X(TYPE_INT64, fmi3Int64) X(TYPE_UINT64, fmi3UInt64) X(TYPE_BOOLEAN, fmi3Boolean)
#define DEFINE_3(NAME, c_type)                                                                                     \
    static fmi3Status get_##NAME##_3(fmi3Instance i, const fmi3ValueReference r[], size_t n, c_type values[],      \
                                     size_t n_values) {                                                            \
        return (fmi3Status)get_toy(i, r, n, values, n_values, NAME, 1);                                            \
    }                                                                                                              \
    static fmi3Status set_##NAME##_3(fmi3Instance i, const fmi3ValueReference r[], size_t n, const c_type values[],\
                                     size_t n_values) {                                                            \
        return (fmi3Status)set_toy(i, r, n, values, n_values, NAME, 1);                                            \
    }
EACH_TYPE_3(DEFINE_3)

static const Function getters_2[] = {[TYPE_FLOAT64] = (Function)get_TYPE_FLOAT64_2,
                                     [TYPE_INT32] = (Function)get_TYPE_INT32_2,
                                     [TYPE_BOOLEAN_2] = (Function)get_TYPE_BOOLEAN_2_2};
static const Function setters_2[] = {[TYPE_FLOAT64] = (Function)set_TYPE_FLOAT64_2,
                                     [TYPE_INT32] = (Function)set_TYPE_INT32_2,
                                     [TYPE_BOOLEAN_2] = (Function)set_TYPE_BOOLEAN_2_2};
#define GETTER_3(NAME, c_type) [NAME] = (Function)get_##NAME##_3,
#define SETTER_3(NAME, c_type) [NAME] = (Function)set_##NAME##_3,
static const Function getters_3[] = {EACH_TYPE_3(GETTER_3)};
static const Function setters_3[] = {EACH_TYPE_3(SETTER_3)};

static fmi2Status set_derivatives_2(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                    const fmi2Integer orders[], const fmi2Real values[]) {
    return (fmi2Status)derive_toy(c, r, n, orders, values);
}

static fmi2Status get_state_2(fmi2Component c, fmi2FMUstate *state) { return (fmi2Status)save_toy(c, state); }
static fmi2Status set_state_2(fmi2Component c, fmi2FMUstate state) { return (fmi2Status)restore_toy(c, state); }
static fmi3Status get_state_3(fmi3Instance i, fmi3FMUState *state) { return (fmi3Status)save_toy(i, state); }
static fmi3Status set_state_3(fmi3Instance i, fmi3FMUState state) { return (fmi3Status)restore_toy(i, state); }

#endif
