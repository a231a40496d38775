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

#include "plan.h" /* which includes the types of its version of FMI */

#if VERSION == 3
#define FMI fmi3
#define TYPES(X)                                                                           \
    X(Float64, FLOAT64) X(Float32, FLOAT32) X(Int8, INT8) X(UInt8, UINT8) X(Int16, INT16)  \
    X(UInt16, UINT16) X(Int32, INT32) X(UInt32, UINT32) X(Int64, INT64) X(UInt64, UINT64)  \
    X(Boolean, BOOLEAN) X(String, STRING)
#define VALUES(values, count) values, count
#define Real Float64
/* Functions with another name than in FMI 2.0. */
#define GetFMUstate GetFMUState
#define SetFMUstate SetFMUState
#define FreeFMUstate FreeFMUState
#define SerializedFMUstateSize SerializedFMUStateSize
#define SerializeFMUstate SerializeFMUState
#define DeSerializeFMUstate DeserializeFMUState
#define GetDerivatives GetContinuousStateDerivatives
typedef fmi3Instance Component;
typedef fmi3FMUState State;
#else
#define FMI fmi2
#define TYPES(X) X(Real, REAL) X(Integer, INTEGER) X(Boolean, BOOLEAN) X(String, STRING)
#define VALUES(values, count) values
typedef fmi2Component Component;
typedef fmi2FMUstate State;
#endif

#define JOIN(a, b) JOIN_(a, b)
#define JOIN_(a, b) a##b
#define TYPE(name) JOIN(FMI, name)
#define TEXT(a) TEXT_(a)
#define TEXT_(a) #a
#define NAME(name) TEXT(FMI) TEXT(name)

#define MOST_EVENTS 10

static FILE *trace;
static size_t letters; /* of all texts of the FMU, so that they are read */
static void *library;
static Component component;
static int ended, fatal; /* whether a call answered with fmi2Error or fmi2Fatal, and with fmi2Fatal */

/* Return a function, and write its name to the trace; NULL after a failed call, or if the library lacks it.
 * Functions of source code may have a prefix. */
static void (*find_function(const char *name))(void) {
    char prefixed[sizeof PREFIX + 64];
    void *symbol = dlsym(library, name);
    snprintf(prefixed, sizeof prefixed, "%s%s", PREFIX, name);
    if (!symbol) symbol = dlsym(library, prefixed);
    if (!ended && symbol) {
        fprintf(trace, "%s\n", name);
        fflush(trace);
    }
    return ended ? NULL : (void (*)(void))symbol;
}

/* Write a bad status to the trace; return whether the call succeeded. */
static int record_status(TYPE(Status) status) {
    if (status >= TYPE(Discard)) fprintf(trace, "%d\n", (int)status);
    fatal = fatal || status == TYPE(Fatal);
    ended = ended || fatal || status == TYPE(Error);
    return status <= TYPE(Warning);
}

/* Call a function if the library has it and no earlier call failed; return whether it succeeded. */
#define CALL(name, ...)                                                                    \
    ((call = find_function(NAME(name))) ? record_status(((JOIN(TYPE(name), TYPE) *)call)(__VA_ARGS__)) : 0)
static void (*call)(void);

#if VERSION == 3
static void log_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                        fmi3String message) {
    (void)environment;
    if (category) letters += strlen(category);
    if (status >= fmi3Discard) fprintf(trace, "# %.200s\n", message ? message : "");
}
#else
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
#endif

static void *copy_to_heap(const void *from, size_t size) {
    void *to = malloc(size ? size : 1);
    if (!to) exit(2);
    if (size) memcpy(to, from, size);
    return to;
}

#define IS_TEXT_STRING 1
#if VERSION == 3
enum {
    IS_TEXT_FLOAT64, IS_TEXT_FLOAT32 = 0, IS_TEXT_INT8 = 0, IS_TEXT_UINT8 = 0, IS_TEXT_INT16 = 0, IS_TEXT_UINT16 = 0,
    IS_TEXT_INT32 = 0, IS_TEXT_UINT32 = 0, IS_TEXT_INT64 = 0, IS_TEXT_UINT64 = 0, IS_TEXT_BOOLEAN = 0
};
#else
enum { IS_TEXT_REAL, IS_TEXT_INTEGER = 0, IS_TEXT_BOOLEAN = 0 };
#endif

static void read_strings(size_t n, TYPE(String) const *values) {
    for (size_t k = 0; k < n; k++) letters += values[k] ? strlen(values[k]) : 0;
}

/* Strings of the host live only during the call, as the standard says. */
static void copy_strings(size_t n, TYPE(String) *values) {
    for (size_t k = 0; k < n; k++) values[k] = copy_to_heap(values[k], strlen(values[k]) + 1);
}

static void free_strings(size_t n, TYPE(String) const *values) {
    for (size_t k = 0; k < n; k++) free((void *)values[k]);
}

/* Functions to set and get variables of a type: `n` value references with `count` values. */
#define ACCESS(Type, LETTERS)                                                              \
    static void set_##Type(size_t n, const TYPE(ValueReference) *references, size_t count, \
                           const TYPE(Type) *values) {                                     \
        TYPE(ValueReference) *vr;                                                          \
        TYPE(Type) *copy;                                                                  \
        if (!n) return;                                                                    \
        vr = copy_to_heap(references, n * sizeof *vr);                                     \
        copy = copy_to_heap(values, count * sizeof *copy);                                 \
        if (IS_TEXT_##LETTERS) copy_strings(count, (void *)copy);                          \
        CALL(Set##Type, component, vr, n, VALUES(copy, count));                            \
        if (IS_TEXT_##LETTERS) free_strings(count, (void *)copy);                          \
        free(copy);                                                                        \
        free(vr);                                                                          \
    }                                                                                      \
    static void get_##Type(size_t n, const TYPE(ValueReference) *references, size_t count) { \
        TYPE(ValueReference) *vr;                                                          \
        TYPE(Type) *values;                                                                \
        if (!n) return;                                                                    \
        vr = copy_to_heap(references, n * sizeof *vr);                                     \
        values = calloc(count, sizeof *values);                                            \
        if (CALL(Get##Type, component, vr, n, VALUES(values, count)) && IS_TEXT_##LETTERS) \
            read_strings(count, (void *)values);                                           \
        free(values);                                                                      \
        free(vr);                                                                          \
    }

TYPES(ACCESS)

#define SET_TYPE(Type, group, LETTERS) \
    set_##Type(group##_##LETTERS##_REFERENCES, group##_##LETTERS, group##_##LETTERS##_COUNT, group##_##LETTERS##_VALUES);
#define GET_TYPE(Type, group, LETTERS) \
    get_##Type(group##_##LETTERS##_REFERENCES, group##_##LETTERS, group##_##LETTERS##_COUNT);
/* START: what can be set before initialization. INPUT and ALL: without clocked variables. TICK and TICKED: clocked
 * inputs, and all clocked variables. */
#define SET_START(Type, LETTERS) SET_TYPE(Type, START, LETTERS)
#define SET_INPUT(Type, LETTERS) SET_TYPE(Type, INPUT, LETTERS)
#define SET_TICK(Type, LETTERS) SET_TYPE(Type, TICK, LETTERS)
#define GET_ALL(Type, LETTERS) GET_TYPE(Type, ALL, LETTERS)
#define GET_TICKED(Type, LETTERS) GET_TYPE(Type, TICKED, LETTERS)
static void set_start(void) { TYPES(SET_START) }
static void set_inputs(void) { TYPES(SET_INPUT) }
static void set_clocked(void) { TYPES(SET_TICK) }
static void get_all(void) { TYPES(GET_ALL) }
static void get_clocked(void) { TYPES(GET_TICKED) }

static void get_derivatives(void) {
    TYPE(ValueReference) *unknowns, *knowns;
    double *seed, *derivatives;
    if (!PROVIDES_DERIVATIVES || !UNKNOWN_REFERENCES || !KNOWN_REFERENCES) return;
    unknowns = copy_to_heap(UNKNOWN, UNKNOWN_REFERENCES * sizeof *unknowns);
    knowns = copy_to_heap(KNOWN, KNOWN_REFERENCES * sizeof *knowns);
    seed = calloc(KNOWN_COUNT, sizeof *seed);
    derivatives = calloc(UNKNOWN_COUNT, sizeof *derivatives);
    CALL(GetDirectionalDerivative, component, unknowns, UNKNOWN_REFERENCES, knowns, KNOWN_REFERENCES, VALUES(seed, KNOWN_COUNT),
         VALUES(derivatives, UNKNOWN_COUNT));
    free(derivatives);
    free(seed);
    free(knowns);
    free(unknowns);
}

static double now;
static unsigned long ticks[CLOCKS + 1]; /* the number of each clock's ticks */

/* Get a state, do something, set it again; the same with its bytes. */
static void run_and_restore_states(void (*between)(void)) {
    State state = NULL, again = NULL;
    const double then = now;
    unsigned long known[CLOCKS + 1];
    size_t size = 0;
    if (!HAS_STATES || !CALL(GetFMUstate, component, &state)) return;
    memcpy(known, ticks, sizeof known);
    between();
    CALL(SetFMUstate, component, state);
    now = then;
    memcpy(ticks, known, sizeof known);
    if (SERIALIZES && CALL(SerializedFMUstateSize, component, state, &size) && size > 0 && size < 1u << 28) {
        TYPE(Byte) *bytes = calloc(size, 1);
        if (CALL(SerializeFMUstate, component, state, bytes, size) &&
            CALL(DeSerializeFMUstate, component, bytes, size, &again)) {
            CALL(SetFMUstate, component, again);
            CALL(FreeFMUstate, component, &again);
        }
        free(bytes);
    }
    CALL(GetFMUstate, component, &state); /* the FMU may use the memory of a state again */
    CALL(FreeFMUstate, component, &state);
}

/* Update the discrete states in event mode until they need no more of it. */
static void update_states(void) {
#if VERSION == 3
    fmi3Boolean *flags = calloc(5, sizeof *flags);
    fmi3Float64 *next = calloc(1, sizeof *next);
    flags[0] = fmi3True;
    for (int k = 0; k < MOST_EVENTS && flags[0]; k++)
        if (!CALL(UpdateDiscreteStates, component, &flags[0], &flags[1], &flags[2], &flags[3], &flags[4], next)) break;
    free(next);
    free(flags);
#else
    fmi2EventInfo *info = calloc(1, sizeof *info);
    info->newDiscreteStatesNeeded = fmi2True;
    for (int k = 0; k < MOST_EVENTS && info->newDiscreteStatesNeeded; k++)
        if (!CALL(NewDiscreteStates, component, info)) break;
    free(info);
#endif
}

#if VERSION == 3
static double next_tick(int k) { return START_TIME + CLOCK_SHIFT[k] + (double)ticks[k] * CLOCK_INTERVAL[k]; }

/* Tick the clocks that are due, in event mode; without one, only update the discrete states. */
static void tick(void) {
    fmi3ValueReference *due = calloc(CLOCKS + 1, sizeof *due);
    fmi3Clock *active = calloc(CLOCKS + 1, sizeof *active);
    size_t count = 0;
    for (int k = 0; k < CLOCKS; k++)
        if (next_tick(k) <= now + 1e-9 * STEP) {
            ticks[k]++;
            active[count] = fmi3ClockActive;
            due[count++] = CLOCK[k];
        }
    if (count) {
        CALL(SetClock, component, due, count, active);
        if (count == CLOCKS) { /* all clocked variables are accessible */
            set_clocked();
            get_clocked();
        }
    }
    update_states();
    CALL(EnterStepMode, component);
    free(active);
    free(due);
}

static void advance(double end) {
    fmi3Boolean *flags = calloc(3, sizeof *flags);
    fmi3Float64 *reached = calloc(1, sizeof *reached);
    if (CALL(DoStep, component, now, end - now, fmi3True, &flags[0], &flags[1], &flags[2], reached)) now = end;
    free(reached);
    free(flags);
}

static void step(void) {
    const double end = now + STEP;
    set_inputs();
    while (!ended && now < end) {
        double stop = end;
        for (int k = 0; k < CLOCKS; k++)
            if (next_tick(k) < stop - 1e-9 * STEP) stop = next_tick(k);
        const double before = now;
        advance(stop);
        if (now == before) break;
        if (EVENTS) {
            CALL(EnterEventMode, component);
            tick();
        }
    }
    get_all();
}
#else
static void step(void) {
    set_inputs();
    if (CALL(DoStep, component, now, STEP, fmi2True)) now += STEP;
    get_all();
}
#endif

static void handle_events(void) {
    update_states();
    CALL(EnterContinuousTimeMode, component);
}

static size_t state_count = STATES, indicator_count = INDICATORS;

static void integrate(void) {
    double *x = calloc(state_count ? state_count : 1, sizeof *x), *slopes = calloc(state_count ? state_count : 1, sizeof *slopes);
    double *nominals = calloc(state_count ? state_count : 1, sizeof *nominals);
    double *indicators = calloc(indicator_count ? indicator_count : 1, sizeof *indicators);
    TYPE(Boolean) *event = calloc(1, sizeof *event), *end = calloc(1, sizeof *end);
    set_inputs();
    if (state_count) {
        CALL(GetContinuousStates, component, x, state_count);
        CALL(GetDerivatives, component, slopes, state_count);
        CALL(GetNominalsOfContinuousStates, component, nominals, state_count);
    }
    now += STEP;
    CALL(SetTime, component, now);
    for (size_t k = 0; k < state_count; k++) x[k] += STEP * slopes[k];
    if (state_count) CALL(SetContinuousStates, component, x, state_count);
    if (indicator_count) CALL(GetEventIndicators, component, indicators, indicator_count);
    CALL(CompletedIntegratorStep, component, TYPE(True), event, end);
    get_all();
    if (*event) {
        CALL(EnterEventMode, component);
        handle_events();
    }
    free(end);
    free(event);
    free(indicators);
    free(nominals);
    free(slopes);
    free(x);
}

static void initialize(void) {
#if VERSION == 3
    CALL(EnterInitializationMode, component, fmi3False, 0.0, START_TIME, fmi3False, 0.0);
#else
    CALL(SetupExperiment, component, fmi2False, 0.0, START_TIME, fmi2False, 0.0);
    CALL(EnterInitializationMode, component);
#endif
    set_inputs();
    set_clocked();
    get_all();
    get_clocked();
    CALL(ExitInitializationMode, component);
#if VERSION == 3
    if (IS_MODEL) {
        CALL(GetNumberOfContinuousStates, component, &state_count);
        CALL(GetNumberOfEventIndicators, component, &indicator_count);
    }
#endif
    if (IS_MODEL) handle_events();
#if VERSION == 3
    if (EVENTS) tick();
#endif
}

static void run(int steps) {
    void (*const move)(void) = IS_MODEL ? integrate : step;
    now = START_TIME;
    memset(ticks, 0, sizeof ticks);
    set_start();
    initialize();
    for (int k = 0; k < steps && !ended; k++) {
        move();
        if (k == steps / 2) {
            get_derivatives();
            run_and_restore_states(move);
        }
    }
    CALL(Terminate, component);
    get_all();
}

/* Arguments of an instantiation, on the heap until the instance was freed. */
typedef struct {
    char *name, *guid, *resources;
    void *callbacks;
} Arguments;

/* Return a new instance, NULL if there is none. */
static Component instantiate(const Arguments *arguments) {
#if VERSION == 3
    void (*create)(void) = find_function(IS_MODEL ? "fmi3InstantiateModelExchange" : "fmi3InstantiateCoSimulation");
    if (!create) return NULL;
    if (IS_MODEL)
        return ((fmi3InstantiateModelExchangeTYPE *)create)(arguments->name, arguments->guid, arguments->resources,
                                                            fmi3False, fmi3True, NULL, log_message);
    return ((fmi3InstantiateCoSimulationTYPE *)create)(arguments->name, arguments->guid, arguments->resources,
                                                       fmi3False, fmi3True, EVENTS, fmi3False, NULL, 0, NULL,
                                                       log_message, NULL);
#else
    fmi2InstantiateTYPE *create = (fmi2InstantiateTYPE *)find_function("fmi2Instantiate");
    const fmi2Type kind = IS_MODEL ? fmi2ModelExchange : fmi2CoSimulation;
    if (!create) return NULL;
    return create(arguments->name, kind, arguments->guid, arguments->resources, arguments->callbacks, fmi2False,
                  fmi2True);
#endif
}

/* Run an instance twice, and free it; return whether the FMU could be instantiated. */
static int run_instance(void) {
#if VERSION == 3
    void *callbacks = NULL;
#else
    const fmi2CallbackFunctions functions = {log_message, allocate, release, NULL, NULL};
    void *callbacks = copy_to_heap(&functions, sizeof functions);
#endif
    const Arguments arguments = {copy_to_heap("examined", 9), copy_to_heap(GUID, sizeof GUID),
                                 copy_to_heap(RESOURCES, sizeof RESOURCES), callbacks};
    int was_instantiated = 0;
    component = instantiate(&arguments);
    if (component) {
        JOIN(TYPE(FreeInstance), TYPE) *free_instance;
        run(STEPS);
        CALL(Reset, component);
        run(STEPS / 2);
        was_instantiated = 1;
        ended = fatal; /* an instance in error can be freed */
        CALL(SetDebugLogging, component, TYPE(False), 0, NULL);
        ended = fatal;
        free_instance = (JOIN(TYPE(FreeInstance), TYPE) *)find_function(NAME(FreeInstance));
        if (free_instance) free_instance(component);
    }
    component = NULL;
    free(arguments.resources);
    free(arguments.guid);
    free(arguments.name);
    free(arguments.callbacks);
    return was_instantiated;
}

int main(int count, char **arguments) {
    if (count != 3 || !(trace = fopen(arguments[2], "w"))) return 2;
    library = dlopen(arguments[1], RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        fprintf(trace, "dlopen %s\n", dlerror());
        return 2;
    }
    for (int k = 0; k < INSTANCES && !fatal; k++)
        if (!run_instance()) {
            fprintf(trace, "NULL\n");
            return 3;
        }
    if (!fatal) fprintf(trace, "end\n");
    fclose(trace);
    return 0; /* the library stays loaded: reports need its symbols, and what it keeps for itself is no leak */
}
