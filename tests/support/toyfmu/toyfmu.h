/* The exported functions of an FMU that is written by hand, for FMI 2.0 or 3.0 (macro FMI, 2 or 3).
 *
 * A C file includes this header, defines `struct Model` with COMMON as its first member, a table of variables
 * and `static const Toy toy = {...}` with hooks. Each hook may be missing. Hooks return a status as numbers that
 * both versions of the standard share. Without hooks, an FMU
 *
 *   - checks the GUID (macro MODEL_GUID), and refuses calls in a wrong mode with an error,
 *   - sets memory to 0 and calls `start` when it is instantiated and reset,
 *   - gets and sets what the table of variables says, which is also its FMU state.
 */
#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if FMI == 2
#include "fmi2Functions.h"
#define EXPORT
#define NAME(function) fmi2##function
typedef fmi2Status Status;
typedef fmi2Boolean Boolean;
#else
#include "fmi3FunctionTypes.h"
#define EXPORT __attribute__((visibility("default")))
#define NAME(function) fmi3##function
typedef fmi3Status Status;
typedef fmi3Boolean Boolean;
#endif

enum { OK, WARNING, DISCARDED, ERROR, FATAL, PENDING };

/* Modes; EVENT and STEP are those of co-simulation and, as event and continuous-time mode, of Model Exchange. */
enum { INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, STEP = 8, TERMINATED = 16, CONFIGURATION = 32, FAILED = 64 };
#define ANY_MODE 127

/* In which modes a variable can be set. */
enum { OUTPUT = 0, PARAMETER = INSTANTIATED | INITIALIZATION, DISCRETE = PARAMETER | EVENT, INPUT = DISCRETE | STEP,
       STRUCTURAL = CONFIGURATION };

typedef enum { FLOAT64, FLOAT32, INT8, UINT8, INT16, UINT16, INT32, UINT32, INT64, UINT64, BOOLEAN, STRING } Type;
static const size_t size_of[] = {8, 4, 1, 1, 2, 2, 4, 4, 8, 8, sizeof(Boolean), 64}; /* a String has its characters */

typedef struct Model Model;

/* Members that each model begins with: `events` says whether it has event mode. */
#define COMMON \
    struct { \
        double time, begin; \
        int mode, events, early, type; \
    }
typedef COMMON Common;

typedef struct {
    unsigned reference;
    Type type;
    size_t offset, count;
    int settable;
} Variable;

#define SIZE_OF_MEMBER(member) sizeof(((Model *)0)->member)
#define VARIABLE(reference, type, member, settable) \
    {reference, type, offsetof(Model, member), SIZE_OF_MEMBER(member), settable}

/* First members of `toy`. */
#define MODEL(variables_) \
    .size = sizeof(Model), .variables = variables_, .n_variables = sizeof variables_ / sizeof variables_[0]

typedef struct {
    double last; /* the time that the step reached */
    int event, terminate, early;
    int no_return; /* whether the host will not go back to times before this step */
} Step;

typedef struct {
    int again, terminate, values_changed, has_next;
    double next;
} Update;

typedef struct {
    size_t size;       /* sizeof(Model) */
    size_t state_size; /* the leading part of it that an FMU state keeps and a reset clears, all of it by default */
    const Variable *variables;
    size_t n_variables;
    int exchange;     /* for Model Exchange instead of co-simulation */
    unsigned null_strings; /* if not 0, empty Strings with this reference or a larger one are NULL */

    int (*before)(Model *, const char *function);                 /* before each call but of FreeInstance */
    int (*wrong_mode)(Model *, const char *function);             /* what is returned; ERROR by default */
    int (*refused)(Model *, const char *function, unsigned reference);
    int (*accepts)(const Common *);                               /* whether there can be such an instance */
    void (*start)(Model *);                                       /* start values */
    void (*created)(Model *);
    void (*freed)(Model *);
    int (*set_up)(Model *, int has_tolerance, double tolerance);  /* the start time is known */
    int (*enter_configuration)(Model *);
    int (*exit_configuration)(Model *);
    int (*enter_initialization)(Model *);
    int (*exit_initialization)(Model *);
    int (*terminate)(Model *);
    int (*reset)(Model *);                                        /* in place of a new start */
    int (*step)(Model *, double time, double step, Step *);
    int (*enter_events)(Model *);
    int (*update)(Model *, Update *);
    int (*leave_events)(Model *);
    void (*compute)(Model *);                                     /* values that follow from others, before they are got */
    size_t (*count)(const Model *, const Variable *);             /* number of elements, where it varies */
    int (*forbids)(Model *, unsigned reference, const void *set); /* an access; `set` is NULL if it gets the value */
    void (*changed)(Model *, unsigned reference);                 /* after a value was set */

    int (*set_clock)(Model *, unsigned reference, int active);
    int (*get_clock)(Model *, unsigned reference, Boolean *);
    int (*interval)(Model *, unsigned reference, double *, int *qualifier);
    int (*shift)(Model *, unsigned reference, double *);

    int (*set_state)(Model *, const Model *state);                /* before it is set */
    void (*count_state)(int change);
    size_t (*state_bytes)(const Model *);
    int (*set_input_derivative)(Model *, unsigned reference, int order, double);
    int (*cancel)(Model *);
    int (*status)(Model *, int kind, void *value);                /* of fmi2Get...Status */

    size_t states, indicators, state_offset;
    void (*derivatives)(Model *, double *);
    void (*get_indicators)(Model *, double *);
    int (*completed)(Model *, int *enters_event_mode);
} Toy;

static const Toy toy; /* defined at the end of the C file */

/* ---- the host, whose callbacks no state keeps; it lies before the model ------------------------ */

typedef struct {
    char *name;
    void *environment;
    int logging;
#if FMI == 2
    fmi2CallbackLogger logger;
#else
    fmi3LogMessageCallback logger;
#endif
} Host;

static Host *host_of(const Model *m) { return (Host *)m - 1; }
static Common *common(Model *m) { return (Common *)m; }

/* Log a message without any % in it; returns the status. */
__attribute__((unused)) static int say(const Model *m, int status, const char *format, ...) {
    static const char *const categories[] = {"logEvents",      "logStatusWarning", "logStatusDiscard",
                                             "logStatusError", "logStatusFatal",   "logStatusPending"};
    const Host *host = host_of(m);
    char message[512];
    va_list arguments;
    if (host->logger == NULL || (status == OK && !host->logging)) return status;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
#if FMI == 2
    host->logger(host->environment, host->name, (Status)status, categories[status], message);
#else
    host->logger(host->environment, (Status)status, categories[status], message);
#endif
    return status;
}

static size_t state_size(void) { return toy.state_size ? toy.state_size : toy.size; }

static int restart(Model *m) {
    const Common old = *common(m);
    memset(m, 0, state_size());
    common(m)->events = old.events, common(m)->early = old.early, common(m)->type = old.type;
    common(m)->mode = INSTANTIATED;
    if (toy.start) toy.start(m);
    return OK;
}

static Model *create(const char *name, const char *guid, Common like, Host host) {
    Host *memory = calloc(1, sizeof(Host) + toy.size);
    Model *m = memory ? (Model *)(memory + 1) : NULL;
    if (!m) return NULL;
    *memory = host;
    *common(m) = like;
    memory->name = strcpy(malloc(strlen(name) + 1), name);
    if (like.type != toy.exchange || strcmp(guid, MODEL_GUID) || (toy.accepts && !toy.accepts(&like))) {
        say(m, ERROR, "wrong type of instance, or the GUID is not " MODEL_GUID ".");
        return free(memory->name), free(memory), NULL;
    }
    restart(m);
    if (toy.created) toy.created(m);
    return m;
}

/* Begin a function that can be called in these modes. */
static int enter(Model *m, const char *function, int modes) {
    const int status = toy.before ? toy.before(m, function) : OK;
    if (status) return status;
    if (common(m)->mode & modes) return OK;
    return toy.wrong_mode ? toy.wrong_mode(m, function) : ERROR;
}

#define ENTER(modes) \
    Model *const m = i; \
    do { \
        const int entered = enter(m, __func__, modes); \
        if (entered) return (Status)entered; \
    } while (0)

/* Change the mode, and call a hook without further arguments. */
#define CHANGE(mode_, hook) return (common(m)->mode = (mode_), (Status)(toy.hook ? toy.hook(m) : OK))

EXPORT void NAME(FreeInstance)(void *i) {
    if (!i) return;
    if (toy.freed) toy.freed(i);
    free(host_of(i)->name);
    free(host_of(i));
}
static int do_set_up(Model *m, int has_tolerance, double tolerance, double begin) {
    common(m)->time = common(m)->begin = begin;
    return toy.set_up ? toy.set_up(m, has_tolerance, tolerance) : OK;
}
EXPORT Status NAME(ExitInitializationMode)(void *i) {
    ENTER(INITIALIZATION);
    CHANGE(common(m)->events ? EVENT : STEP, exit_initialization);
}
EXPORT Status NAME(Terminate)(void *i) {
    ENTER(EVENT | STEP);
    const int status = toy.terminate ? toy.terminate(m) : OK;
    common(m)->mode = TERMINATED;
    return (Status)status;
}
EXPORT Status NAME(Reset)(void *i) {
    ENTER(ANY_MODE);
    const int status = toy.reset ? toy.reset(m) : restart(m);
    common(m)->mode = INSTANTIATED;
    return (Status)status;
}
EXPORT Status NAME(EnterEventMode)(void *i) {
    ENTER(STEP);
    if (!common(m)->events) return (Status)ERROR;
    CHANGE(EVENT, enter_events);
}
static int do_update(Model *m, Update *update) {
    *update = (Update){0};
    return toy.update ? toy.update(m, update) : ERROR;
}

/* ---- variables ----------------------------------------------------------------------------- */

static const Variable *find(unsigned reference, Type type) {
    for (size_t k = 0; k < toy.n_variables; k++)
        if (toy.variables[k].reference == reference && toy.variables[k].type == type) return &toy.variables[k];
    return NULL;
}
static size_t count(const Model *m, const Variable *v) {
    return toy.count && v->count > size_of[v->type] ? toy.count(m, v) : v->count / size_of[v->type];
}
static int refuse_access(Model *m, const char *function, unsigned reference) {
    return toy.refused ? toy.refused(m, function, reference) : ERROR;
}
static int get_values(Model *m, const char *function, Type type, const unsigned r[], size_t n, void *values, size_t nv) {
    const int status = enter(m, function, ANY_MODE);
    size_t at = 0;
    if (status) return status;
    if (toy.compute) toy.compute(m);
    for (size_t k = 0; k < n; k++) {
        const Variable *v = find(r[k], type);
        const size_t length = v ? count(m, v) : 0;
        if (!v || at + length > nv || (toy.forbids && toy.forbids(m, r[k], NULL)))
            return refuse_access(m, function, r[k]);
        char *source = (char *)m + v->offset;
        if (type == STRING) ((const char **)values)[at] = toy.null_strings && r[k] >= toy.null_strings && !*source ? NULL : source;
        else memcpy((char *)values + at * size_of[type], source, length * size_of[type]);
        at += length;
    }
    return at == nv ? OK : ERROR;
}
static int set_values(Model *m, const char *function, Type type, const unsigned r[], size_t n, const void *values,
                      size_t nv) {
    const int status = enter(m, function, ANY_MODE & ~(TERMINATED | FAILED));
    if (status) return status;
    const size_t element = type == STRING ? sizeof(char *) : size_of[type];
    for (int writes = 0; writes < 2; writes++) {
        size_t at = 0;
        for (size_t k = 0; k < n; k++) {
            const Variable *v = find(r[k], type);
            const size_t length = v ? count(m, v) : 0;
            const char *source = (const char *)values + at * element;
            if (!v || at + length > nv || !(v->settable & common(m)->mode) ||
                (!writes && toy.forbids && toy.forbids(m, r[k], source)))
                return refuse_access(m, function, r[k]);
            at += length;
            if (!writes) continue;
            char *target = (char *)m + v->offset;
            if (type == STRING) strncpy(target, *(const char *const *)source, size_of[STRING] - 1);
            else memcpy(target, source, length * element);
            if (toy.changed) toy.changed(m, r[k]);
        }
        if (at != nv) return ERROR;
    }
    return OK;
}

/* ---- states --------------------------------------------------------------------------------- */

static int copy_state(const void *source, void **target) {
    if (!*target) {
        *target = malloc(state_size());
        if (toy.count_state) toy.count_state(1);
    }
    memcpy(*target, source, state_size());
    return OK;
}
static int set_state(Model *m, const void *state) {
    const int status = !state ? ERROR : toy.set_state ? toy.set_state(m, state) : OK;
    if (!status) memcpy(m, state, state_size());
    return status;
}
static int free_state(void **state) {
    if (state && *state && toy.count_state) toy.count_state(-1);
    if (state) free(*state), *state = NULL;
    return OK;
}
#define STATE_FUNCTIONS(State, Deserialize, Byte) \
    EXPORT Status NAME(Get##State)(void *i, void **s) { ENTER(ANY_MODE); return (Status)copy_state(m, s); } \
    EXPORT Status NAME(Set##State)(void *i, void *s) { ENTER(ANY_MODE); return (Status)set_state(m, s); } \
    EXPORT Status NAME(Free##State)(void *i, void **s) { ENTER(ANY_MODE); return (Status)free_state(s); } \
    EXPORT Status NAME(Serialized##State##Size)(void *i, void *s, size_t *n) { \
        ENTER(ANY_MODE); \
        *n = toy.state_bytes ? toy.state_bytes(m) : state_size(); \
        return (Status)(s ? OK : ERROR); \
    } \
    EXPORT Status NAME(Serialize##State)(void *i, void *s, Byte bytes[], size_t n) { \
        ENTER(ANY_MODE); \
        if (!s || n < state_size()) return (Status)ERROR; \
        memcpy(bytes, s, state_size()); \
        return (Status)OK; \
    } \
    EXPORT Status NAME(Deserialize)(void *i, const Byte bytes[], size_t n, void **s) { \
        ENTER(ANY_MODE); \
        return (Status)(n == state_size() ? copy_state(bytes, s) : ERROR); \
    }

/* ---- steps and Model Exchange ---------------------------------------------------------------- */

static int do_step(Model *m, double time, double size, int no_return, Step *step) {
    *step = (Step){.last = time + size, .no_return = no_return};
    return toy.step ? toy.step(m, time, size, step) : ERROR;
}
static double *states_of(Model *m) { return (double *)((char *)m + toy.state_offset); }

EXPORT Status NAME(EnterContinuousTimeMode)(void *i) {
    ENTER(EVENT);
    CHANGE(STEP, leave_events);
}
EXPORT Status NAME(SetTime)(void *i, double time) {
    ENTER(STEP);
    common(m)->time = time;
    return (Status)OK;
}
EXPORT Status NAME(SetContinuousStates)(void *i, const double x[], size_t n) {
    ENTER(STEP);
    memcpy(states_of(m), x, n * sizeof *x);
    return (Status)OK;
}
EXPORT Status NAME(GetContinuousStates)(void *i, double x[], size_t n) {
    ENTER(ANY_MODE);
    memcpy(x, states_of(m), n * sizeof *x);
    return (Status)OK;
}
EXPORT Status NAME(GetNominalsOfContinuousStates)(void *i, double x[], size_t n) {
    ENTER(ANY_MODE);
    for (size_t k = 0; k < n; k++) x[k] = 1.0;
    return (Status)OK;
}
EXPORT Status NAME(GetEventIndicators)(void *i, double z[], size_t n) {
    ENTER(ANY_MODE);
    if (n && toy.get_indicators) toy.get_indicators(m, z);
    return (Status)OK;
}
EXPORT Status NAME(CompletedIntegratorStep)(void *i, Boolean no_return, Boolean *enters, Boolean *ends) {
    ENTER(STEP);
    int event = 0;
    const int status = toy.completed ? toy.completed(m, &event) : OK;
    *enters = event != 0, *ends = 0;
    return (Status)status;
}
static int get_derivatives(Model *m, double dx[]) {
    if (toy.derivatives) toy.derivatives(m, dx);
    return toy.derivatives ? OK : ERROR;
}

#if FMI == 2 /* ============================================================================== */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    const Host host = {NULL, functions->componentEnvironment, logging, functions->logger};
    const int exchange = type == fmi2ModelExchange;
    return create(name, guid, (Common){.type = exchange, .events = exchange}, host);
}
fmi2Status fmi2SetDebugLogging(fmi2Component i, fmi2Boolean on, size_t n, const fmi2String names[]) {
    ENTER(ANY_MODE);
    host_of(m)->logging = on;
    return fmi2OK;
}
fmi2Status fmi2SetupExperiment(fmi2Component i, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real begin,
                               fmi2Boolean has_end, fmi2Real end) {
    ENTER(INSTANTIATED);
    return (Status)do_set_up(m, has_tolerance, tolerance, begin);
}
fmi2Status fmi2EnterInitializationMode(fmi2Component i) {
    ENTER(INSTANTIATED);
    CHANGE(INITIALIZATION, enter_initialization);
}

#define ACCESS(Name, TYPE) \
    fmi2Status fmi2Get##Name(fmi2Component i, const fmi2ValueReference r[], size_t n, fmi2##Name v[]) { \
        return (Status)get_values(i, __func__, TYPE, r, n, v, n); \
    } \
    fmi2Status fmi2Set##Name(fmi2Component i, const fmi2ValueReference r[], size_t n, const fmi2##Name v[]) { \
        return (Status)set_values(i, __func__, TYPE, r, n, v, n); \
    }
ACCESS(Real, FLOAT64)
ACCESS(Integer, INT32)
ACCESS(Boolean, BOOLEAN)
ACCESS(String, STRING)

STATE_FUNCTIONS(FMUstate, DeSerializeFMUstate, fmi2Byte)

fmi2Status fmi2DoStep(fmi2Component i, fmi2Real time, fmi2Real size, fmi2Boolean no_return) {
    ENTER(STEP);
    Step step;
    const int status = do_step(m, time, size, no_return, &step);
    return (Status)status;
}
fmi2Status fmi2CancelStep(fmi2Component i) {
    ENTER(ANY_MODE);
    return (Status)(toy.cancel ? toy.cancel(m) : ERROR);
}

#define STATUS(Name, type) \
    fmi2Status fmi2Get##Name(fmi2Component i, const fmi2StatusKind kind, type *value) { \
        ENTER(ANY_MODE); \
        return (Status)(toy.status ? toy.status(m, kind, value) : DISCARDED); \
    }
STATUS(Status, fmi2Status)
STATUS(RealStatus, fmi2Real)
STATUS(IntegerStatus, fmi2Integer)
STATUS(BooleanStatus, fmi2Boolean)
STATUS(StringStatus, fmi2String)

fmi2Status fmi2SetRealInputDerivatives(fmi2Component i, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real v[]) {
    ENTER(INSTANTIATED | INITIALIZATION | STEP);
    int status = toy.set_input_derivative ? OK : ERROR;
    for (size_t k = 0; k < n && !status; k++) status = toy.set_input_derivative(m, r[k], order[k], v[k]);
    return (Status)status;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component i, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real v[]) {
    ENTER(ANY_MODE);
    return n ? fmi2Error : fmi2OK;
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component i, const fmi2ValueReference z[], size_t nz,
                                        const fmi2ValueReference x[], size_t nx, const fmi2Real dx[], fmi2Real dz[]) {
    ENTER(ANY_MODE);
    return nz ? fmi2Error : fmi2OK;
}
fmi2Status fmi2NewDiscreteStates(fmi2Component i, fmi2EventInfo *info) {
    ENTER(EVENT);
    Update u;
    const int status = do_update(m, &u);
    *info = (fmi2EventInfo){u.again, u.terminate, 0, u.values_changed, u.has_next, u.next};
    return (Status)status;
}
fmi2Status fmi2GetDerivatives(fmi2Component i, fmi2Real dx[], size_t n) {
    ENTER(ANY_MODE);
    return (Status)get_derivatives(m, dx);
}

#else /* FMI 3.0 ============================================================================= */

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String c[]) {
    ENTER(ANY_MODE);
    host_of(m)->logging = on;
    return fmi3OK;
}
EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                                const fmi3ValueReference required[], size_t n,
                                                fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
                                                fmi3IntermediateUpdateCallback update) {
    return create(name, token, (Common){.events = events, .early = early}, (Host){NULL, environment, logging, message});
}
EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String path,
                                                 fmi3Boolean visible, fmi3Boolean logging,
                                                 fmi3InstanceEnvironment environment, fmi3LogMessageCallback message) {
    return create(name, token, (Common){.events = 1, .type = 1}, (Host){NULL, environment, logging, message});
}
EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance i) {
    ENTER(INSTANTIATED);
    CHANGE(CONFIGURATION, enter_configuration);
}
EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance i) {
    ENTER(CONFIGURATION);
    CHANGE(INSTANTIATED, exit_configuration);
}
EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                              fmi3Float64 begin, fmi3Boolean has_end, fmi3Float64 end) {
    ENTER(INSTANTIATED);
    const int status = do_set_up(m, has_tolerance, tolerance, begin);
    if (status) return (Status)status;
    CHANGE(INITIALIZATION, enter_initialization);
}

#define ACCESS(Name, TYPE) \
    EXPORT fmi3Status fmi3Get##Name(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3##Name v[], size_t nv) { \
        return (Status)get_values(i, __func__, TYPE, r, n, v, nv); \
    } \
    EXPORT fmi3Status fmi3Set##Name(fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3##Name v[], \
                                    size_t nv) { \
        return (Status)set_values(i, __func__, TYPE, r, n, v, nv); \
    }
ACCESS(Float64, FLOAT64)
ACCESS(Float32, FLOAT32)
ACCESS(Int8, INT8)
ACCESS(UInt8, UINT8)
ACCESS(Int16, INT16)
ACCESS(UInt16, UINT16)
ACCESS(Int32, INT32)
ACCESS(UInt32, UINT32)
ACCESS(Int64, INT64)
ACCESS(UInt64, UINT64)
ACCESS(Boolean, BOOLEAN)
ACCESS(String, STRING)

STATE_FUNCTIONS(FMUState, DeserializeFMUState, fmi3Byte)

EXPORT fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_return,
                             fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    ENTER(STEP);
    Step step;
    const int status = do_step(m, time, size, no_return, &step);
    *event = step.event, *terminate = step.terminate, *early = step.early, *last = step.last;
    return (Status)status;
}
EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance i) {
    ENTER(EVENT);
    CHANGE(STEP, leave_events);
}
EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean *again, fmi3Boolean *ends, fmi3Boolean *nominals,
                                           fmi3Boolean *states, fmi3Boolean *has_next, fmi3Float64 *next) {
    ENTER(EVENT);
    Update u;
    const int status = do_update(m, &u);
    *again = u.again, *ends = u.terminate, *nominals = 0, *states = u.values_changed, *has_next = u.has_next;
    *next = u.next;
    return (Status)status;
}
EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance i, fmi3Float64 dx[], size_t n) {
    ENTER(ANY_MODE);
    return (Status)get_derivatives(m, dx);
}
EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance i, size_t *n) {
    ENTER(ANY_MODE);
    *n = toy.states;
    return fmi3OK;
}
EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance i, size_t *n) {
    ENTER(ANY_MODE);
    *n = toy.indicators;
    return fmi3OK;
}

/* Call a hook for each of n references, until one fails. */
#define FOR_EACH(hook, ...) \
    int status = toy.hook ? OK : ERROR; \
    for (size_t k = 0; k < n && !status; k++) status = toy.hook(m, r[k], __VA_ARGS__); \
    return (Status)status

EXPORT fmi3Status fmi3SetClock(fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Clock v[]) {
    ENTER(EVENT);
    FOR_EACH(set_clock, v[k]);
}
EXPORT fmi3Status fmi3GetClock(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Clock v[]) {
    ENTER(EVENT);
    FOR_EACH(get_clock, &v[k]);
}
EXPORT fmi3Status fmi3GetIntervalDecimal(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 v[],
                                         fmi3IntervalQualifier q[]) {
    ENTER(INITIALIZATION | EVENT);
    FOR_EACH(interval, &v[k], (int *)&q[k]);
}
EXPORT fmi3Status fmi3GetShiftDecimal(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 v[]) {
    ENTER(INITIALIZATION);
    FOR_EACH(shift, &v[k]);
}

/* Functions that a host looks up, and that these FMUs have no use for. */
#define ABSENT(function) \
    EXPORT fmi3Status fmi3##function(void) { return fmi3Error; }
#ifndef HAS_BINARY
ABSENT(GetBinary)
ABSENT(SetBinary)
#endif
ABSENT(ActivateModelPartition)
ABSENT(EvaluateDiscreteStates)
ABSENT(GetAdjointDerivative)
ABSENT(GetDirectionalDerivative)
ABSENT(GetIntervalFraction)
ABSENT(GetNumberOfVariableDependencies)
ABSENT(GetOutputDerivatives)
ABSENT(GetShiftFraction)
ABSENT(GetVariableDependencies)
ABSENT(InstantiateScheduledExecution)
ABSENT(SetIntervalDecimal)
ABSENT(SetIntervalFraction)
ABSENT(SetShiftDecimal)
ABSENT(SetShiftFraction)

#endif
