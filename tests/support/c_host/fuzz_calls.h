/* One function per call of FMI 2.0: with arguments that are random and often wrong, and checks of what
 * comes back.
 */
#ifndef FUZZ_CALLS_H
#define FUZZ_CALLS_H

#include "fuzz_harness.h"

/* ---- instances ------------------------------------------------------------------------- */

static void free_saved(Saved *s) {
    if (s->state == NULL) return;
    CALL(FreeFMUstate, s->owner, &s->state);
    if (s->state != NULL) fail("a freed state is not NULL");
    s->owner = NULL;
}

static void free_instance(Instance *instance) {
    for (size_t i = 0; i < STATES; i++)
        if (saved[i].owner == instance) free_saved(&saved[i]);
    model.fmu.FreeInstance(instance->component);
    counts[ID_FreeInstance][fmi2OK]++;
    free(instance->name);
    *instance = (Instance){0};
}

static void create_instance(Instance *instance) {
    static const fmi2Type types[] = {fmi2ModelExchange, (fmi2Type)2, (fmi2Type)77};
    static const char *const names[] = {"a", "lift.plant", "100 %s%n%d%", "\xce\xa9 \xff\n\"<"};
    static const char *const guids[] = {NULL, "", "{00000000-0000-0000-0000-000000000000}", "%s%n", "{"};
    static const char *const resources[] = {NULL, "", "file:///nowhere", "%20%s", "http://[::1]:99999/"};
    static const fmi2CallbackLogger loggers[] = {check_message, check_message, check_message, NULL};
    /* the model description says that these are not used */
    static fmi2CallbackFunctions callbacks[INSTANCES];
    fmi2CallbackFunctions *given = &callbacks[instance - instances];
    const int is_right = !happens(wildness / 2.0), is_named = !happens(wildness / 8.0);

    *given = (fmi2CallbackFunctions){ONE_OF(loggers), NULL, NULL, NULL, instance};
    instance->name = copied(is_named ? ONE_OF(names) : happens(0.5) ? "" : NULL);
    if (is_named && happens(0.05)) {
        free(instance->name);
        instance->name = allocate(20000, 1);
        memset(instance->name, 'n', 19999);
        instance->name[19999] = '\0';
    }
    instance->type = fmi2CoSimulation;
    if (offers_model_exchange() && happens(0.4)) instance->type = fmi2ModelExchange;
    if (happens(wildness / 4.0)) instance->type = ONE_OF(types);
    /* the FMU has to copy what it keeps: these are freed at once */
    char *name = copied(instance->name), *guid = copied(is_right ? model.guid : ONE_OF(guids));
    char *location = copied(ONE_OF(resources));
    instance->component = model.fmu.Instantiate(name, instance->type, guid, location, given, any_integer(),
                                                happens(0.7) ? fmi2True : any_integer());
    free(name), free(guid), free(location);
    const int was_made = instance->component != NULL;
    counts[ID_Instantiate][was_made ? fmi2OK : fmi2Error]++;
    if (verbose)
        fprintf(stderr, "  %d fmi2Instantiate type %d: %s\n", (int)(instance - instances), instance->type,
                was_made ? "made" : "refused");
    if (was_made && !is_right) fail("a wrong GUID was accepted");
    if (was_made && !is_named) fail("an instance without a name was made");
    if (was_made && instance->type != fmi2CoSimulation && instance->type != fmi2ModelExchange)
        fail("an FMU type was accepted that does not exist");
    if (!was_made && is_right && is_named && instance->type == fmi2CoSimulation) fail("fmi2Instantiate has failed");
    instance->phase = CREATED;
    if (was_made) return;
    free(instance->name);
    *instance = (Instance){0};
}

static void become(Instance *instance, fmi2Status status, Phase phase) {
    if (status <= fmi2Warning) instance->phase = phase;
}

/* ---- vectors --------------------------------------------------------------------------- */

/* An array, or NULL: wrong where there should be any elements, but told easily. */
#define OR_NULL(array) (happens(wildness / 20.0) ? NULL : (array))

static size_t any_length(void) {
    if (happens(0.005)) return MANY;
    return happens(0.1) ? 0 : happens(0.9) ? 1 + below(8) : 2 * n_variables;
}

/* A variable of a type that may be set in a phase; NULL if luck does not find one. */
static const Variable *pick(char type, int setting, Phase phase) {
    for (int attempt = 0; attempt < 50; attempt++) {
        const Variable *v = &variables[below(n_variables)];
        if (v->type != type) continue;
        if (!setting || v->role == 'i' || (strchr("ps", v->role) != NULL && phase <= INITIALIZING)) return v;
    }
    return NULL;
}

/* References, all of them of variables of the type (and settable), or with wrong ones among them.
 * Values that suit them go to `values` where it is not NULL. */
static fmi2ValueReference *references(size_t n, char type, int setting, Phase phase, double *values) {
    fmi2ValueReference *found = allocate(n, sizeof *found);
    const int wrong = happens(wildness / 2.0), weird = happens(wildness / 2.0);
    for (size_t i = 0; i < n; i++) {
        const Variable *v = n == MANY && i > 0 ? NULL : pick(type, setting, phase);
        found[i] = v != NULL ? v->reference : i > 0 ? found[0] : any_reference();
        if (wrong && happens(2.0 / (double)n)) found[i] = any_reference();
        if (values != NULL) values[i] = v != NULL && !(weird && happens(0.5)) ? sane_value(v) : any_real();
    }
    return found;
}

static int is_type(fmi2ValueReference reference, char type) {
    for (size_t i = 0; i < n_variables; i++)
        if (variables[i].reference == reference) return variables[i].type == type;
    return 0;
}

/* Nothing but references to variables of the type may be answered with fmi2OK. */
static void check_accepted(fmi2Status status, const fmi2ValueReference *vr, size_t n, char type) {
    for (size_t i = 0; status <= fmi2Warning && i < n && i < 100; i++)
        if (!is_type(vr[i], type)) fail("the value reference %u was accepted as type %c", vr[i], type);
}

static int as_integer(double value) { return fabs(value) < 2e9 ? (int)value : any_integer(); }

#define GET_AND_SET(Name, Type, letter, convert)                                                      \
    static void get_##Name(Instance *instance) {                                                      \
        const size_t n = any_length();                                                                \
        fmi2ValueReference *vr = references(n, letter, 0, instance->phase, NULL);                     \
        Type *values = allocate(n, sizeof *values);                                                   \
        const fmi2Status status = CALL(Get##Name, instance, OR_NULL(vr), n, OR_NULL(values));         \
        check_accepted(status, vr, n, letter);                                                        \
        free(vr), free(values);                                                                       \
    }                                                                                                 \
    static void set_##Name(Instance *instance) {                                                      \
        const size_t n = any_length();                                                                \
        double *numbers = allocate(n, sizeof *numbers);                                               \
        fmi2ValueReference *vr = references(n, letter, 1, instance->phase, numbers);                  \
        Type *values = allocate(n, sizeof *values);                                                   \
        for (size_t i = 0; i < n; i++) values[i] = convert(numbers[i]);                               \
        const fmi2Status status = CALL(Set##Name, instance, OR_NULL(vr), n, OR_NULL(values));         \
        check_accepted(status, vr, n, letter);                                                        \
        free(vr), free(values), free(numbers);                                                        \
    }

GET_AND_SET(Real, fmi2Real, 'r', )
GET_AND_SET(Integer, fmi2Integer, 'i', as_integer)
GET_AND_SET(Boolean, fmi2Boolean, 'b', as_integer)

static void get_String(Instance *instance) {
    const size_t n = any_length();
    fmi2ValueReference *vr = references(n, 'r', 0, instance->phase, NULL);
    fmi2String *values = allocate(n, sizeof *values);
    check_accepted(CALL(GetString, instance, vr, n, values), vr, n, 's');
    free(vr), free(values);
}

static void set_String(Instance *instance) {
    static const fmi2String texts[] = {"", "text", "%s%n", NULL};
    const size_t n = any_length();
    fmi2ValueReference *vr = references(n, 'r', 1, instance->phase, NULL);
    fmi2String *values = allocate(n, sizeof *values);
    for (size_t i = 0; i < n; i++) values[i] = ONE_OF(texts);
    check_accepted(CALL(SetString, instance, vr, n, values), vr, n, 's');
    free(vr), free(values);
}

static void get_DirectionalDerivative(Instance *instance) {
    const size_t n = any_length(), m = n < MANY ? any_length() : below(3); /* not 1e10 pairs */
    fmi2ValueReference *unknown = references(n, 'r', 0, instance->phase, NULL);
    fmi2ValueReference *known = references(m, 'r', 1, instance->phase, NULL);
    double *seed = allocate(m, sizeof *seed), *result = allocate(n, sizeof *result);
    for (size_t i = 0; i < m; i++) seed[i] = happens(wildness) ? any_real() : 1.0;
    CALL(GetDirectionalDerivative, instance, OR_NULL(unknown), n, OR_NULL(known), m, OR_NULL(seed), result);
    free(unknown), free(known), free(seed), free(result);
}

static fmi2Integer *orders(size_t n) {
    fmi2Integer *found = allocate(n, sizeof *found);
    for (size_t i = 0; i < n; i++) found[i] = happens(wildness / 4.0) ? any_integer() : 1;
    return found;
}

static void set_RealInputDerivatives(Instance *instance) {
    const size_t n = any_length();
    double *values = allocate(n, sizeof *values);
    fmi2ValueReference *vr = references(n, 'r', 1, STEPPING, values);
    fmi2Integer *order = orders(n);
    CALL(SetRealInputDerivatives, instance, OR_NULL(vr), n, OR_NULL(order), OR_NULL(values));
    free(vr), free(order), free(values);
}

static void get_RealOutputDerivatives(Instance *instance) {
    const size_t n = any_length();
    double *values = allocate(n, sizeof *values);
    fmi2ValueReference *vr = references(n, 'r', 0, STEPPING, NULL);
    fmi2Integer *order = orders(n);
    for (size_t i = 0; i < n; i++)
        if (n_outputs > 0 && !happens(wildness / 4.0)) vr[i] = outputs[below(n_outputs)];
    CALL(GetRealOutputDerivatives, instance, OR_NULL(vr), n, OR_NULL(order), OR_NULL(values));
    free(vr), free(order), free(values);
}

/* ---- phases ---------------------------------------------------------------------------- */

static void setup(Instance *instance) {
    const double start = happens(wildness) ? any_real() : uniform(-1.0, 10.0);
    const double stop = happens(wildness) ? any_real() : start + uniform(-1.0, 10.0);
    const double tolerance = happens(0.5) ? any_real() : 1e-6;
    CALL(SetupExperiment, instance, any_integer(), tolerance, start, any_integer(), stop);
}

static void enter_initialization(Instance *instance) {
    become(instance, CALL_ALONE(EnterInitializationMode, instance), INITIALIZING);
}

static void exit_initialization(Instance *instance) {
    const Phase next = instance->type == fmi2CoSimulation ? STEPPING : EVENTS;
    become(instance, CALL_ALONE(ExitInitializationMode, instance), next);
}

static void terminate(Instance *instance) { become(instance, CALL_ALONE(Terminate, instance), TERMINATED); }

static void reset(Instance *instance) { become(instance, CALL_ALONE(Reset, instance), CREATED); }

static void set_logging(Instance *instance) {
    static const char *const odd[] = {NULL, "", "logNonsense", "%s%n", "logall", "logStatusErrorX"};
    const size_t n = any_length();
    char **names = allocate(n, sizeof *names);
    const int is_odd = happens(wildness);
    for (size_t i = 0; i < n; i++)
        names[i] = copied(is_odd && happens(0.3) ? ONE_OF(odd) : categories[below(n_categories)]);
    CALL(SetDebugLogging, instance, happens(0.8) ? fmi2True : any_integer(), n, (const fmi2String *)names);
    for (size_t i = 0; i < n; i++) free(names[i]);
    free(names);
}

/* ---- steps ----------------------------------------------------------------------------- */

static int read_outputs(const Instance *instance, double *values) {
    return n_outputs == 0 || CALL(GetReal, instance, outputs, n_outputs, values) <= fmi2Warning;
}

static double current_time(const Instance *instance) {
    double time = 0.0;
    if (instance->type == fmi2CoSimulation) CALL(GetRealStatus, instance, fmi2LastSuccessfulTime, &time);
    return time;
}

static double any_step(const Instance *instance) {
    static const double odd[] = {0.0,   -0.0,     -1e-3,     5e-324,  1e-300, 1e-18, NAN,
                                 1e300, INFINITY, -INFINITY, DBL_MAX, 1e10,   1e5,   -1e300};
    double substep = 1e-3; /* of a model that does not integrate */
    if (internal_step >= 0) {
        const fmi2ValueReference vr = (fmi2ValueReference)internal_step;
        CALL(GetReal, instance, &vr, 1, &substep);
    }
    const double quick = substep > 0.0 ? fmin(0.1, QUICK_SUBSTEPS * substep) : 0.1;
    const double step = happens(wildness) ? ONE_OF(odd) : quick * pow(uniform(0.0, 1.0), 4.0);
    const double substeps = fabs(step / substep);
    return internal_step >= 0 && substeps > QUICK_SUBSTEPS && substeps < REFUSED_SUBSTEPS ? quick : step;
}

/* A step that is OK leaves finite outputs at its end; one that is not leaves what was. */
static void do_step(Instance *instance) {
    const double now = current_time(instance), step = any_step(instance);
    const double time = happens(wildness / 2.0) ? (happens(0.5) ? any_real() : now + step) : now;
    double *before = allocate(n_outputs, sizeof *before), *after = allocate(n_outputs, sizeof *after);
    const int was_readable = read_outputs(instance, before);
    if (verbose) fprintf(stderr, "    from %a by %a, at %a\n", time, step, now);
    const fmi2Status status = CALL(DoStep, instance, time, step, any_integer());
    const int is_done = status <= fmi2Warning, is_readable = read_outputs(instance, after);
    if (is_done ? !is_readable : is_readable != was_readable) fail("outputs cannot be read after a step");
    for (size_t i = 0; is_readable && i < n_outputs; i++) {
        if (is_done && !isfinite(after[i]))
            fail("after a step that was OK, output %u is %g", outputs[i], after[i]);
        if (!is_done && memcmp(&before[i], &after[i], sizeof *after) != 0)
            fail("a refused step has changed output %u from %a to %a", outputs[i], before[i], after[i]);
    }
    const double end = current_time(instance), expected = is_done ? time + step : now;
    if (is_done && !isfinite(end)) fail("a step that was OK ended at the time %g", end);
    /* an instance counts steps of one length, so that it may end some rounding off the sum */
    const double rounding = nextafter(fabs(expected), HUGE_VAL) - fabs(expected);
    const int is_there = is_done ? fabs(end - expected) <= 2e-6 * step + rounding : end == expected;
    /* a sliver within rounding of the time is OK and does nothing */
    const int is_sliver = is_done && !is_there && end == now;
    for (size_t i = 0; is_sliver && i < n_outputs; i++)
        if (was_readable && memcmp(&before[i], &after[i], sizeof *after) != 0)
            fail("a step that went nowhere has changed output %u", outputs[i]);
    if (instance->type == fmi2CoSimulation && !is_there && !is_sliver)
        fail("a step from %a by %a that was %s ended at %a", time, step, status_name(status), end);
    free(before), free(after);
}

static void get_versions(Instance *instance) {
    if (strcmp(model.fmu.GetVersion(), "2.0") != 0) fail("the version has changed");
    if (strcmp(model.fmu.GetTypesPlatform(), "default") != 0) fail("the types platform has changed");
    counted(ID_GetVersion, instance, fmi2OK);
    counted(ID_GetTypesPlatform, instance, fmi2OK);
}

static void cancel_step(Instance *instance) { CALL_ALONE(CancelStep, instance); }

static void get_statuses(Instance *instance) {
    const fmi2StatusKind kind = happens(0.8) ? (fmi2StatusKind)below(4) : (fmi2StatusKind)99;
    fmi2Status status;
    fmi2Real real;
    fmi2Integer integer;
    fmi2Boolean boolean;
    fmi2String string;
    CALL(GetStatus, instance, kind, &status);
    CALL(GetRealStatus, instance, kind, OR_NULL(&real));
    CALL(GetIntegerStatus, instance, kind, OR_NULL(&integer));
    CALL(GetBooleanStatus, instance, kind, OR_NULL(&boolean));
    CALL(GetStringStatus, instance, kind, &string);
}

/* ---- FMU states ------------------------------------------------------------------------ */

/* Into an empty place, or over a state that is there. */
static void get_state(Instance *instance) {
    Saved *s = &saved[below(STATES)];
    const int is_new = s->state == NULL;
    if (CALL(GetFMUstate, instance, NULL) <= fmi2Warning) fail("a state was put nowhere");
    const fmi2Status status = CALL(GetFMUstate, instance, &s->state);
    if (s->state == NULL && (status <= fmi2Warning || !is_new)) fail("fmi2GetFMUstate gave no state");
    if (is_new && s->state != NULL) s->owner = instance;
    if (status <= fmi2Warning) s->phase = instance->phase;
}

/* A state of this model, mostly; or of the other, or none. */
static fmi2FMUstate any_state(Phase *phase) {
    const Saved *s = &saved[below(STATES)];
    *phase = s->phase;
    return happens(wildness / 4.0) ? strange_state : s->state;
}

static void set_state(Instance *instance) {
    Phase phase;
    fmi2FMUstate state = any_state(&phase);
    const fmi2Status status = CALL(SetFMUstate, instance, state);
    if (status <= fmi2Warning && (state == NULL || state == strange_state)) fail("a foreign state was set");
    become(instance, status, phase);
}

static void free_state(Instance *instance) {
    fmi2FMUstate none = NULL;
    if (happens(0.2)) CALL(FreeFMUstate, instance, &none);
    if (happens(0.2)) CALL(FreeFMUstate, instance, NULL);
    free_saved(&saved[below(STATES)]);
}

/* Bytes of a state of an instance, or of the foreign model; their number in `size`. */
static char *serialized(const Library *library, fmi2Component component, fmi2FMUstate state, size_t *size) {
    if (library->fmu.SerializedFMUstateSize(component, state, size) > fmi2Warning) return NULL;
    char *bytes = allocate(*size, 1);
    if (library->fmu.SerializeFMUstate(component, state, bytes, *size) > fmi2Warning)
        fail("a state that has a size cannot be serialized");
    return bytes;
}

static void serialize_state(Instance *instance) {
    Phase phase;
    fmi2FMUstate state = any_state(&phase);
    size_t needed = 0;
    const fmi2Status sized = CALL(SerializedFMUstateSize, instance, state, &needed);
    if (sized <= fmi2Warning && state == strange_state) fail("a foreign state has a size");
    if (CALL(SerializedFMUstateSize, instance, state, NULL) <= fmi2Warning) fail("a size was put nowhere");
    const size_t sizes[] = {needed, needed, needed + 1, needed + 4096, needed > 0 ? needed - 1 : 0,
                            needed / 2, 8, 0};
    const size_t size = ONE_OF(sizes);
    char *bytes = allocate(size, 1);
    const fmi2Status status = CALL(SerializeFMUstate, instance, state, OR_NULL(bytes), size);
    if (status <= fmi2Warning && size < needed) fail("a state of %zu bytes was written to %zu", needed, size);
    free(bytes);
}

static void damage(char *bytes, size_t size) {
    if (size < sizeof(double)) return;
    for (size_t n = 1 + below(4); n > 0; n--) {
        const double value = any_real();
        switch (below(3)) {
            case 0: bytes[below(size)] ^= (char)(1 << below(8)); break;
            case 1: bytes[below(size)] = (char)random_bits(); break;
            default: memcpy(bytes + below(size / sizeof value) * sizeof value, &value, sizeof value); break;
        }
    }
}

/* What is deserialized: a state as it is, damaged, cut off or lengthened; noise; the foreign model's. */
static char *any_bytes(const Instance *instance, fmi2FMUstate state, size_t *size, int *is_whole) {
    enum { WHOLE, DAMAGED, CUT, LONG, NOISE, N_KINDS };
    const int is_foreign = happens(0.15), kind = happens(wildness) ? (int)below(N_KINDS) : WHOLE;
    size_t length = 0;
    char *whole = is_foreign ? serialized(&foreign, stranger, strange_state, &length)
                             : serialized(&model, instance->component, state, &length);
    *size = kind == CUT ? below(length + 1) : kind == LONG ? length + 1 + below(100) : length;
    if (kind == NOISE && happens(0.5)) *size = below(5000);
    char *bytes = allocate(*size, 1);
    if (bytes != NULL && whole != NULL) memcpy(bytes, whole, *size < length ? *size : length);
    if (kind == DAMAGED) damage(bytes, *size);
    for (size_t i = 0; kind == NOISE && i < *size; i++) bytes[i] = (char)random_bits();
    *is_whole = !is_foreign && whole != NULL && *size == length && memcmp(bytes, whole, length) == 0;
    free(whole);
    return bytes;
}

static void deserialize_state(Instance *instance) {
    Saved *source = &saved[below(STATES)], *target = &saved[below(STATES)];
    size_t size;
    int is_whole;
    char *bytes = any_bytes(instance, source->state, &size, &is_whole);
    const Phase phase = source->phase;
    free_saved(target); /* the standard does not say that a state can be deserialized into another */
    const fmi2Status status = CALL(DeSerializeFMUstate, instance, bytes, size, &target->state);
    if ((status <= fmi2Warning) != is_whole || (target->state != NULL) != is_whole)
        fail("%s bytes were answered with %s", is_whole ? "the right" : "damaged or foreign",
             status_name(status));
    if (target->state != NULL) *target = (Saved){target->state, instance, phase};
    free(bytes);
    if (target->state != NULL && happens(0.7))
        become(instance, CALL(SetFMUstate, instance, target->state), phase);
}

/* What the standard does not define, but an FMU should survive: over a state of the other model. */
static void get_state_over_a_foreign_one(Instance *instance) {
    fmi2FMUstate target = NULL;
    foreign.fmu.GetFMUstate(stranger, &target);
    if (CALL(GetFMUstate, instance, &target) <= fmi2Warning)
        CALL(FreeFMUstate, instance, &target);
    else
        foreign.fmu.FreeFMUstate(stranger, &target);
}

/* ---- Model Exchange -------------------------------------------------------------------- */

static void check_boolean(fmi2Boolean value) {
    if (value != fmi2True && value != fmi2False) fail("a Boolean was set to %d", value);
}

static void enter_events(Instance *instance) {
    become(instance, CALL_ALONE(EnterEventMode, instance), EVENTS);
}

static void enter_continuous_time(Instance *instance) {
    become(instance, CALL_ALONE(EnterContinuousTimeMode, instance), CONTINUOUS);
}

static void new_discrete_states(Instance *instance) {
    fmi2EventInfo *info = allocate(1, sizeof *info);
    if (CALL(NewDiscreteStates, instance, info) <= fmi2Warning) {
        check_boolean(info->newDiscreteStatesNeeded);
        check_boolean(info->terminateSimulation);
        check_boolean(info->nominalsOfContinuousStatesChanged);
        check_boolean(info->valuesOfContinuousStatesChanged);
        check_boolean(info->nextEventTimeDefined);
        if (info->nextEventTimeDefined && !isfinite(info->nextEventTime))
            fail("the next event is at %g", info->nextEventTime);
    }
    free(info);
}

static void completed_integrator_step(Instance *instance) {
    fmi2Boolean enter = 77, end = 77;
    if (CALL(CompletedIntegratorStep, instance, any_integer(), &enter, &end) > fmi2Warning) return;
    check_boolean(enter);
    check_boolean(end);
}

static void set_time(Instance *instance) {
    CALL(SetTime, instance, happens(wildness) ? any_real() : uniform(-1.0, 10.0));
}

static size_t length_near(size_t right) { return happens(wildness / 2.0) ? below(right + 3) : right; }

static void set_continuous_states(Instance *instance) {
    const size_t n = length_near(n_states);
    double *x = allocate(n, sizeof *x);
    for (size_t i = 0; i < n; i++) x[i] = happens(wildness / 4.0) ? any_real() : uniform(-1.0, 1.0);
    if (CALL(SetContinuousStates, instance, OR_NULL(x), n) <= fmi2Warning && n > n_states)
        fail("%zu continuous states were accepted instead of %zu", n, n_states);
    free(x);
}

#define GET_VECTOR(Name, right, is_sound)                                                             \
    static void get_##Name(Instance *instance) {                                                      \
        const size_t n = length_near(right);                                                          \
        double *values = allocate(n, sizeof *values);                                                 \
        const int is_given = CALL(Get##Name, instance, OR_NULL(values), n) <= fmi2Warning;            \
        if (is_given && n > (right)) fail("%zu values were given instead of %zu", n, (right));        \
        for (size_t i = 0; is_given && i < n; i++)                                                    \
            if (!(is_sound)) fail("fmi2Get" #Name " gave %g", values[i]);                             \
        free(values);                                                                                 \
    }

GET_VECTOR(Derivatives, n_states, isfinite(values[i]))
GET_VECTOR(ContinuousStates, n_states, 1)
GET_VECTOR(NominalsOfContinuousStates, n_states, values[i] > 0.0)
GET_VECTOR(EventIndicators, n_indicators, 1)

#endif
