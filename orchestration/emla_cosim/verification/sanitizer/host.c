/* Leads instances of an FMU through their lives; compiled with sanitizers for one FMU, whose data are in plan.h.
 *
 * Arguments: the library, and a file that gets the name of each call. A call that answers with fmi2Discard or
 * worse is followed by its status. Messages of the FMU begin with "#". The last line is "end" if all instances
 * were freed. All memory that goes to the FMU is on the heap and just large enough, so that AddressSanitizer
 * sees each access outside of it.
 */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "plan.h"

#define MOST_EVENTS 10

static FILE *trace;
static size_t letters; /* of all texts of the FMU, so that they are read */
static void *library;
static fmi2Component component;
static int ended, fatal; /* whether a call answered with fmi2Error or fmi2Fatal, and with fmi2Fatal */

/* Functions of source code may have a prefix. */
static void *function(const char *name) {
    char prefixed[sizeof PREFIX + 64];
    void *found = dlsym(library, name);
    snprintf(prefixed, sizeof prefixed, "%s%s", PREFIX, name);
    if (!found) found = dlsym(library, prefixed);
    if (!ended && found) {
        fprintf(trace, "%s\n", name);
        fflush(trace);
    }
    return ended ? NULL : found;
}

static int answered(fmi2Status status) {
    if (status >= fmi2Discard) fprintf(trace, "%d\n", (int)status);
    fatal = fatal || status == fmi2Fatal;
    ended = ended || fatal || status == fmi2Error;
    return status <= fmi2Warning;
}

/* Call a function if the library has it and no earlier call failed; return whether it succeeded. */
#define CALL(name, ...)                                                                    \
    ((call = (void (*)(void))function(#name)) ? answered(((name##TYPE *)call)(__VA_ARGS__)) : 0)
static void (*call)(void);

static void log_message(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    char text[4096];
    va_list arguments;
    (void)environment;
    va_start(arguments, message);
    vsnprintf(text, sizeof text, message, arguments);
    va_end(arguments);
    if (instance) letters += strlen(instance);
    if (category) letters += strlen(category);
    if (status >= fmi2Discard) fprintf(trace, "# %.200s\n", text);
}

static void *allocate(size_t count, size_t size) { return calloc(count, size); }
static void release(void *memory) { free(memory); }

static void *copied(const void *from, size_t size) {
    void *to = malloc(size ? size : 1);
    if (!to) exit(2);
    if (size) memcpy(to, from, size);
    return to;
}

/* Functions to set and get all variables of a type in groups of the plan. */
#define ACCESS(Type, ctype)                                                                \
    static void set_##Type(size_t n, const fmi2ValueReference *references, const ctype *values) { \
        fmi2ValueReference *vr;                                                            \
        ctype *copy;                                                                       \
        if (!n) return;                                                                    \
        vr = copied(references, n * sizeof *vr);                                           \
        copy = copied(values, n * sizeof *copy);                                           \
        CALL(fmi2Set##Type, component, vr, n, copy);                                       \
        free(copy);                                                                        \
        free(vr);                                                                          \
    }                                                                                      \
    static void get_##Type(size_t n, const fmi2ValueReference *references) {               \
        fmi2ValueReference *vr;                                                            \
        ctype *values;                                                                     \
        if (!n) return;                                                                    \
        vr = copied(references, n * sizeof *vr);                                           \
        values = calloc(n, sizeof *values);                                                \
        if (CALL(fmi2Get##Type, component, vr, n, values)) look_at_##Type(n, values);      \
        free(values);                                                                      \
        free(vr);                                                                          \
    }

static void look_at_Real(size_t n, const fmi2Real *values) { (void)n, (void)values; }
static void look_at_Integer(size_t n, const fmi2Integer *values) { (void)n, (void)values; }
static void look_at_Boolean(size_t n, const fmi2Boolean *values) { (void)n, (void)values; }
static void look_at_String(size_t n, const fmi2String *values) {
    for (size_t k = 0; k < n; k++) letters += values[k] ? strlen(values[k]) : 0;
}

ACCESS(Real, fmi2Real)
ACCESS(Integer, fmi2Integer)
ACCESS(Boolean, fmi2Boolean)
ACCESS(String, fmi2String)

/* Strings of the host live only during the call, as the standard says. */
static void set_strings(size_t n, const fmi2ValueReference *references, const fmi2String *values) {
    fmi2String *copies = calloc(n ? n : 1, sizeof *copies);
    for (size_t k = 0; k < n; k++) copies[k] = copied(values[k], strlen(values[k]) + 1);
    set_String(n, references, copies);
    for (size_t k = 0; k < n; k++) free((void *)copies[k]);
    free(copies);
}

#define SET(group)                                                              \
    (set_Real(group##_REALS, group##_REAL, group##_REAL_VALUES),                \
     set_Integer(group##_INTEGERS, group##_INTEGER, group##_INTEGER_VALUES),    \
     set_Boolean(group##_BOOLEANS, group##_BOOLEAN, group##_BOOLEAN_VALUES),    \
     set_strings(group##_STRINGS, group##_STRING, group##_STRING_VALUES))

static void get_all(void) {
    get_Real(ALL_REALS, ALL_REAL);
    get_Integer(ALL_INTEGERS, ALL_INTEGER);
    get_Boolean(ALL_BOOLEANS, ALL_BOOLEAN);
    get_String(ALL_STRINGS, ALL_STRING);
}

static void set_inputs(void) { SET(INPUT); }

static void set_continuous_inputs(void) { set_Real(INPUT_REALS, INPUT_REAL, INPUT_REAL_VALUES); }

static void get_derivatives(void) {
    fmi2ValueReference *unknowns, *knowns;
    fmi2Real *seed, *found;
    if (!PROVIDES_DERIVATIVES || !UNKNOWNS || !INPUT_REALS) return;
    unknowns = copied(UNKNOWN, UNKNOWNS * sizeof *unknowns);
    knowns = copied(INPUT_REAL, INPUT_REALS * sizeof *knowns);
    seed = calloc(INPUT_REALS, sizeof *seed);
    found = calloc(UNKNOWNS, sizeof *found);
    CALL(fmi2GetDirectionalDerivative, component, unknowns, UNKNOWNS, knowns, INPUT_REALS, seed, found);
    free(found);
    free(seed);
    free(knowns);
    free(unknowns);
}

/* Get a state, do something, set it again; the same with its bytes. */
static void use_states(void (*between)(void)) {
    fmi2FMUstate state = NULL, again = NULL;
    size_t size = 0;
    if (!HAS_STATES || !CALL(fmi2GetFMUstate, component, &state)) return;
    between();
    CALL(fmi2SetFMUstate, component, state);
    if (SERIALIZES && CALL(fmi2SerializedFMUstateSize, component, state, &size) && size > 0 && size < 1u << 28) {
        fmi2Byte *bytes = calloc(size, 1);
        if (CALL(fmi2SerializeFMUstate, component, state, bytes, size) &&
            CALL(fmi2DeSerializeFMUstate, component, bytes, size, &again)) {
            CALL(fmi2SetFMUstate, component, again);
            CALL(fmi2FreeFMUstate, component, &again);
        }
        free(bytes);
    }
    CALL(fmi2GetFMUstate, component, &state); /* the FMU may use the memory of a state again */
    CALL(fmi2FreeFMUstate, component, &state);
}

static double now;

static void step(void) {
    set_inputs();
    if (CALL(fmi2DoStep, component, now, STEP, fmi2True)) now += STEP;
    get_all();
}

static void handle_events(void) {
    fmi2EventInfo *info = calloc(1, sizeof *info);
    info->newDiscreteStatesNeeded = fmi2True;
    for (int k = 0; k < MOST_EVENTS && info->newDiscreteStatesNeeded; k++)
        if (!CALL(fmi2NewDiscreteStates, component, info)) break;
    CALL(fmi2EnterContinuousTimeMode, component);
    free(info);
}

static void integrate(void) {
    fmi2Real *x = calloc(STATES ? STATES : 1, sizeof *x), *slopes = calloc(STATES ? STATES : 1, sizeof *slopes);
    fmi2Real *nominals = calloc(STATES ? STATES : 1, sizeof *nominals);
    fmi2Real *indicators = calloc(INDICATORS ? INDICATORS : 1, sizeof *indicators);
    fmi2Boolean *event = calloc(1, sizeof *event), *end = calloc(1, sizeof *end);
    set_continuous_inputs();
    if (STATES) {
        CALL(fmi2GetContinuousStates, component, x, STATES);
        CALL(fmi2GetDerivatives, component, slopes, STATES);
        CALL(fmi2GetNominalsOfContinuousStates, component, nominals, STATES);
    }
    now += STEP;
    CALL(fmi2SetTime, component, now);
    for (size_t k = 0; k < STATES; k++) x[k] += STEP * slopes[k];
    if (STATES) CALL(fmi2SetContinuousStates, component, x, STATES);
    if (INDICATORS) CALL(fmi2GetEventIndicators, component, indicators, INDICATORS);
    CALL(fmi2CompletedIntegratorStep, component, fmi2True, event, end);
    get_all();
    if (*event) {
        CALL(fmi2EnterEventMode, component);
        handle_events();
    }
    free(end);
    free(event);
    free(indicators);
    free(nominals);
    free(slopes);
    free(x);
}

static void run(int steps) {
    void (*const move)(void) = IS_MODEL ? integrate : step;
    now = START_TIME;
    SET(START);
    CALL(fmi2SetupExperiment, component, fmi2False, 0.0, START_TIME, fmi2False, 0.0);
    CALL(fmi2EnterInitializationMode, component);
    set_inputs();
    get_all();
    CALL(fmi2ExitInitializationMode, component);
    if (IS_MODEL) handle_events();
    for (int k = 0; k < steps && !ended; k++) {
        move();
        if (k == steps / 2) {
            get_derivatives();
            use_states(move);
            now = START_TIME + (k + 1) * STEP;
        }
    }
    CALL(fmi2Terminate, component);
    get_all();
}

/* Return whether the FMU could be instantiated. */
static int live(void) {
    const fmi2CallbackFunctions given = {log_message, allocate, release, NULL, NULL};
    fmi2CallbackFunctions *callbacks = copied(&given, sizeof given);
    char *name = copied("examined", 9), *guid = copied(GUID, sizeof GUID);
    char *resources = copied(RESOURCES, sizeof RESOURCES);
    const fmi2Type kind = IS_MODEL ? fmi2ModelExchange : fmi2CoSimulation;
    fmi2InstantiateTYPE *instantiate = (fmi2InstantiateTYPE *)function("fmi2Instantiate");
    fmi2FreeInstanceTYPE *free_instance;
    int lived = 0;
    component = instantiate ? instantiate(name, kind, guid, resources, callbacks, fmi2False, fmi2True) : NULL;
    if (component) {
        run(STEPS);
        CALL(fmi2Reset, component);
        run(STEPS / 2);
        lived = 1;
        ended = fatal; /* an instance in error can be freed */
        CALL(fmi2SetDebugLogging, component, fmi2False, 0, NULL);
        ended = fatal;
        free_instance = (fmi2FreeInstanceTYPE *)function("fmi2FreeInstance");
        if (free_instance) free_instance(component);
    }
    component = NULL;
    free(resources);
    free(guid);
    free(name);
    free(callbacks);
    return lived;
}

int main(int count, char **arguments) {
    if (count != 3 || !(trace = fopen(arguments[2], "w"))) return 2;
    library = dlopen(arguments[1], RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        fprintf(trace, "dlopen %s\n", dlerror());
        return 2;
    }
    for (int k = 0; k < INSTANCES && !fatal; k++)
        if (!live()) {
            fprintf(trace, "NULL\n");
            return 3;
        }
    if (!fatal) fprintf(trace, "end\n");
    fclose(trace);
    return 0; /* the library stays loaded: reports need its symbols, and what it keeps for itself is no leak */
}
