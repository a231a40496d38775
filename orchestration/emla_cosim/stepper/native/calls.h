/* Calls of FMI functions: values of any type, steps, states. */

#if defined __GNUC__ /* calls take less time than what surrounds them, so that a call of our own matters */
#define ALWAYS_INLINE __attribute__((always_inline)) inline
#define NOINLINE __attribute__((noinline))
#else
#define ALWAYS_INLINE
#define NOINLINE
#endif

#if defined _MSC_VER && !defined __STDC_VERSION__ /* its C before C11 has another word */
#define restrict __restrict
#endif

#include "effort.h"

#include "event_tables.h"

/* Whether a status is worse than a warning, or not in the standard. */
static int is_bad(int32_t status) { return status > fmi2Warning || status < fmi2OK; }

ALWAYS_INLINE static void announce(const Stepper *s, int64_t code) {
    if (STEPPER_WATCHED && s->activity != NULL) s->activity->code = code;
}

/* WHOLE_TYPES and OTHER_TYPES apply a macro to a type: its name, its C type, and for whole numbers the smallest
   value and the one after the largest. */
#define WHOLE_TYPES(X)                                                    \
    X(TYPE_INT8, int8_t, -128.0, 128.0)                                   \
    X(TYPE_UINT8, uint8_t, 0.0, 256.0)                                    \
    X(TYPE_INT16, int16_t, -32768.0, 32768.0)                             \
    X(TYPE_UINT16, uint16_t, 0.0, 65536.0)                                \
    X(TYPE_INT32, int32_t, -2147483648.0, 2147483648.0)                   \
    X(TYPE_UINT32, uint32_t, 0.0, 4294967296.0)                           \
    X(TYPE_INT64, int64_t, -9223372036854775808.0, 9223372036854775808.0) \
    X(TYPE_UINT64, uint64_t, 0.0, 18446744073709551616.0)

/* Put numbers of the vector into the values of a call, rounded to its type; 0 if one does not fit. */
static int convert_to(const Call *call, const double *vector) {
#define PUT(NAME, type, low, limit)                                                       \
    case NAME:                                                                            \
        for (int32_t k = 0; k < call->n_items; k++) {                                     \
            const double value = rint(vector[call->items[k]]);                            \
            if (!(value >= (low) && value < (limit))) return 0;                           \
        }                                                                                 \
        for (int32_t k = 0; k < call->n_items; k++)                                       \
            ((type *)call->values)[call->places[k]] = (type)rint(vector[call->items[k]]); \
        return 1;
#define PUT_EACH(NAME, type, expression)                              \
    case NAME:                                                        \
        for (int32_t k = 0; k < call->n_items; k++) {                 \
            const double value = vector[call->items[k]];              \
            ((type *)call->values)[call->places[k]] = (expression);   \
        }                                                             \
        return 1;
    switch (call->type) {
        WHOLE_TYPES(PUT)
        PUT_EACH(TYPE_FLOAT64, double, value)
        PUT_EACH(TYPE_FLOAT32, float, (float)value)
        PUT_EACH(TYPE_BOOLEAN, fmi3Boolean, rint(value) != 0.0)
        PUT_EACH(TYPE_BOOLEAN_2, fmi2Boolean, rint(value) != 0.0)
        default: return 1;
    }
#undef PUT
#undef PUT_EACH
}

/* Put the values of a call into the vector. */
static void convert_from(const Call *call, double *vector) {
#define TAKE(NAME, type, low, limit)                                                              \
    case NAME:                                                                                    \
        for (int32_t k = 0; k < call->n_items; k++)                                               \
            vector[call->items[k]] = (double)((const type *)call->values)[call->places[k]];       \
        return;
#define TAKE_TRUTH(NAME, type)                                                                    \
    case NAME:                                                                                    \
        for (int32_t k = 0; k < call->n_items; k++)                                               \
            vector[call->items[k]] = ((const type *)call->values)[call->places[k]] ? 1.0 : 0.0;   \
        return;
    switch (call->type) {
        WHOLE_TYPES(TAKE)
        TAKE(TYPE_FLOAT64, double, , )
        TAKE(TYPE_FLOAT32, float, , )
        TAKE_TRUTH(TYPE_BOOLEAN, unsigned char)
        TAKE_TRUTH(TYPE_BOOLEAN_2, fmi2Boolean)
        default: return;
    }
#undef TAKE
#undef TAKE_TRUTH
}

/* Functions for all types have the same arguments, apart from the type of the values. */
typedef fmi2Status Exchange2(fmi2Component, const fmi2ValueReference *, size_t, void *);
typedef fmi3Status Exchange3(fmi3Instance, const fmi3ValueReference *, size_t, void *, size_t);

ALWAYS_INLINE static int32_t exchange(const Stepper *s, const Call *call) {
    const size_t n = (size_t)call->n_references;
    announce(s, call->code);
    if (call->is_version_3)
        return (int32_t)((Exchange3 *)call->function)(call->component, call->references, n, call->values,
                                                      (size_t)call->n_values);
    return (int32_t)((Exchange2 *)call->function)(call->component, call->references, n, call->values);
}

/* How bad a status is: one that is not in the standard is worse than a warning, also -1. */
static int64_t badness(int32_t status) { return status < 0 ? fmi2Warning - (int64_t)status : status; }

/* Set numbers of a vector with all these calls, and return the worst status. */
NOINLINE static int32_t set_converted(const Stepper *s, const Call *calls, int32_t n, const double *vector) {
    int32_t worst = fmi2OK;
    for (int32_t k = 0; k < n; k++) {
        if (calls[k].n_items > 0 && !convert_to(&calls[k], vector)) return OUT_OF_RANGE;
        const int32_t status = exchange(s, &calls[k]);
        if (badness(status) > badness(worst)) worst = status;
    }
    return worst;
}

ALWAYS_INLINE static int32_t set_values(const Stepper *s, const Call *calls, int32_t n, const double *vector) {
    return n == 1 && calls->n_items == 0 ? exchange(s, calls) : set_converted(s, calls, n, vector);
}

/* Get numbers of a vector with all these calls, and return the worst status. */
NOINLINE static int32_t get_converted(const Stepper *s, const Call *calls, int32_t n, double *vector) {
    int32_t worst = fmi2OK;
    for (int32_t k = 0; k < n; k++) {
        const int32_t status = calls[k].function == NULL ? fmi2OK : exchange(s, &calls[k]);
        if (calls[k].n_items > 0) convert_from(&calls[k], vector);
        if (badness(status) > badness(worst)) worst = status;
    }
    return worst;
}

ALWAYS_INLINE static int32_t get_values(const Stepper *s, const Call *calls, int32_t n, double *vector) {
    return n == 1 && calls->n_items == 0 ? exchange(s, calls) : get_converted(s, calls, n, vector);
}

/* Note which call failed. */
NOINLINE static int32_t fail(Stepper *s, int32_t failure, int32_t instance, int32_t status) {
    s->instance = instance;
    s->status = status;
    return failure;
}

/* Do the step of an instance of FMI 3.0. A step that is not whole is an error; one after which the instance wants
   the end counts as discarded. `judge_step` of fmi_3_calls.py. */
NOINLINE static int32_t step_3(const FmuInstance *instance, double time, double length) {
    StepEnd *end = instance->end;
    end->needs_event = end->terminates = end->is_early = fmi3False;
    const int32_t status = (int32_t)((fmi3DoStepTYPE *)instance->do_step)(
        instance->component, time, length, instance->has_no_way_back != 0, &end->needs_event, &end->terminates,
        &end->is_early, &end->reached);
    if (is_bad(status)) return status;
    if (end->terminates) return fmi2Discard;
    return end->needs_event || end->is_early ? fmi2Error : status;
}

static int32_t step_with_events(const Stepper *s, Events *events, double time, double length, int32_t has_no_way_back);

ALWAYS_INLINE static int32_t do_step(Stepper *s, int32_t i, double time, double length) {
    const FmuInstance *instance = &s->instances[i];
    announce(s, instance->code + instance->code_step);
    if (STEPPER_WATCHED && s->activity != NULL) s->activity->time = time;
    const int64_t start = start_clock(instance->effort);
    const int32_t status =
        STEPPER_EVENTS && instance->events != NULL
            ? step_with_events(s, instance->events, time, length, instance->has_no_way_back)
        : instance->is_version_3
            ? step_3(instance, time, length)
            : (int32_t)((fmi2DoStepTYPE *)instance->do_step)(instance->component, time, length,
                                                             instance->has_no_way_back ? fmi2True : fmi2False);
    stop_clock(instance->effort, STEP_CALLS, start);
    if (!is_bad(status)) return DONE;
    s->time = time;
    s->length = length;
    return fail(s, STEP_FAILED, i, status);
}

/* Wait for the end of a step that `do_step` has only begun, in another process. */
NOINLINE static int32_t end_step(Stepper *s, int32_t i, double time, double length) {
    const FmuInstance *instance = &s->instances[i];
    announce(s, instance->code + instance->code_step);
    const int32_t status = (int32_t)instance->end_step(instance->component);
    if (!is_bad(status)) return DONE;
    s->time = time;
    s->length = length;
    return fail(s, STEP_FAILED, i, status);
}

/* Whether an instance discarded its step because it wants the run to end: a shorter step is no help then. */
static int wants_end(const Stepper *s, int32_t i) {
    const FmuInstance *instance = &s->instances[i];
    fmi2Boolean answer = fmi2False;
    if (instance->is_version_3) return instance->end->terminates;
    if (instance->get_status == NULL) return 0;
    announce(s, instance->code + instance->code_status);
    const fmi2Status status =
        ((fmi2GetBooleanStatusTYPE *)instance->get_status)(instance->component, fmi2Terminated, &answer);
    return status == fmi2OK && answer != fmi2False;
}

static void copy_memory(double *to, const double *from, const Events *events) {
    memcpy(to, from, (size_t)events->n_memory * sizeof(double));
}

/* Both versions of FMI have the same arguments and statuses for states. */
static int32_t save_state(Stepper *s, int32_t i, SavedState *saved) {
    const FmuInstance *instance = &s->instances[i];
    announce(s, instance->code + instance->code_save);
    const int64_t start = start_clock(instance->effort);
    const int32_t status = (int32_t)((fmi2GetFMUstateTYPE *)instance->get_state)(instance->component, &saved->state);
    stop_clock(instance->effort, STATE_CALLS, start);
    if (is_bad(status)) return fail(s, SAVE_FAILED, i, status);
    if (instance->events != NULL) copy_memory(saved->events, instance->events->memory, instance->events);
    return DONE;
}

static int32_t restore_state(Stepper *s, int32_t i, const SavedState *saved) {
    const FmuInstance *instance = &s->instances[i];
    announce(s, instance->code + instance->code_restore);
    const int64_t start = start_clock(instance->effort);
    const int32_t status = (int32_t)((fmi2SetFMUstateTYPE *)instance->set_state)(instance->component, saved->state);
    stop_clock(instance->effort, STATE_CALLS, start);
    if (is_bad(status)) return fail(s, RESTORE_FAILED, i, status);
    if (instance->events != NULL) copy_memory(instance->events->memory, saved->events, instance->events);
    return DONE;
}
