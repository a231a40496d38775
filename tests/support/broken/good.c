/* An FMI 2.0 FMU that is as it should be, for co-simulation and for model exchange: a mass on a spring,
 *
 *     x' = v,   v' = gain u - K x - C v,   total = x + w / 2,   moving = x > THRESHOLD.
 *
 * A name in resources/fault.txt makes one thing of it wrong; dynamic.py lists them.
 */
#define _DEFAULT_SOURCE /* clock_gettime, usleep */
#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "fmi2Functions.h"

enum { U, W, GAIN, POSITION, SPEED, ACCELERATION, TOTAL, X, V, DER_X, DER_V, TIME, N_REALS };
enum { INSTANTIATED = 1, INITIALIZATION = 2, RUNNING = 4, CONTINUOUS = 8, TERMINATED = 16, FAILED = 32 };
enum { EVENTS, WARNINGS, ERRORS, N_CATEGORIES };

#define K 40.0
#define C 1.0
#define THRESHOLD 0.02
#define SUBSTEP 1e-3  /* s, of the integration */
#define LATER 0.5     /* s, when faults of steps begin */
#define BLOCKS 64     /* of memory, that some faults use */
#define MAGIC 0x600dU /* what the bytes of a state begin with */

typedef struct {
    double time, x, v, u, w, gain, before[3]; /* time, x and v before the last step */
    int phase, moving, poison, last_set;
} Now;

typedef struct {
    unsigned magic, check;
    Now now;
} Bytes;

typedef struct {
    Now own, *now;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    char *name;
    char fault[32];
    int model, logging, shown[N_CATEGORIES], terminates;
    double first_step;
} Instance;

static const char *const CATEGORIES[] = {"logEvents", "logStatusWarning", "logStatusError"};
static Now shared;
static double scratch, kept;
static volatile unsigned spins;
static void *volatile taken; /* keeps the compiler from removing an allocation */

#define IS(name) (strcmp(i->fault, #name) == 0)

/* ---- messages and phases --------------------------------------------------------------- */

static fmi2Status say(const Instance *i, fmi2Status status, const char *format, ...) {
    const int category = status == fmi2OK ? EVENTS : status == fmi2Warning ? WARNINGS : ERRORS;
    char text[256];
    va_list arguments;
    int shown = status != fmi2OK || (i->logging && i->shown[category]);
    if (IS(CATEGORY) && i->logging) shown = 1;
    if (IS(LOG_OFF)) shown = 1;
    if (!shown) return status;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    i->logger(i->environment, i->name, status, CATEGORIES[category], text);
    return status;
}

#define REFUSE(i, ...) ((i)->now->phase = FAILED, say((i), fmi2Error, __VA_ARGS__))
#define REQUIRE(i, phases)                                                                        \
    if (!((i)->now->phase & (phases))) return REFUSE(i, "%s does not belong in this phase.", __func__)

/* ---- equations ------------------------------------------------------------------------- */

static double acceleration(const Instance *i, double x, double v) {
    const double damping = IS(DISAGREE) && !i->model ? 1.2 * C : C;
    return i->now->gain * i->now->u - K * x - damping * v;
}

static void integrate(const Instance *i, double length) {
    const int count = (int)ceil(length / SUBSTEP - 1e-6);
    const double h = length / count;
    Now *n = i->now;
    for (int k = 0; k < count; k++) {
        const double v1 = n->v, a1 = acceleration(i, n->x, v1);
        const double v2 = n->v + 0.5 * h * a1, a2 = acceleration(i, n->x + 0.5 * h * v1, v2);
        const double v3 = n->v + 0.5 * h * a2, a3 = acceleration(i, n->x + 0.5 * h * v2, v3);
        const double v4 = n->v + h * a3, a4 = acceleration(i, n->x + h * v3, v4);
        n->x += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
        n->v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
    }
}

static double real(const Instance *i, fmi2ValueReference r) {
    Now copy = *i->now, *n = &copy;
    if (IS(STALE) && n->phase == RUNNING && !i->model && n->time > 0.0) {
        n->time = n->before[0];
        n->x = n->before[1];
        n->v = n->before[2];
    }
    const double values[N_REALS] = {n->u, n->w, n->gain, n->x, n->v, acceleration(i, n->x, n->v),
                                    n->x + 0.5 * n->w + (IS(RANGE) ? 50.0 : 0.0),
                                    n->x, n->v, n->v, acceleration(i, n->x, n->v), n->time};
    if (n->poison && r == POSITION) return IS(NAN_LATER) ? NAN : INFINITY;
    return values[r];
}

/* ---- instances ------------------------------------------------------------------------- */

static void read_fault(Instance *i, const char *location) {
    char path[1024];
    const char *folder = strncmp(location, "file://", 7) == 0 ? location + 7 : location;
    snprintf(path, sizeof path, "%s/fault.txt", folder);
    FILE *file = fopen(path, "r");
    if (file == NULL) return;
    if (fscanf(file, "%31s", i->fault) != 1) i->fault[0] = 0;
    fclose(file);
}

static void start(Instance *i) {
    const double v = i->now->v;
    memset(i->now, 0, sizeof *i->now);
    i->now->phase = INSTANTIATED;
    i->now->gain = 2.0;
    i->now->x = 0.01;
    if (IS(RESET)) i->now->v = v;
    i->terminates = 0;
    i->first_step = 0.0;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    static int made;
    Instance *i = calloc(1, sizeof *i);
    read_fault(i, fmuResourceLocation);
    i->now = IS(SHARED) ? &shared : &i->own;
    i->logger = functions->logger;
    i->environment = functions->componentEnvironment;
    i->name = strcpy(malloc(strlen(instanceName) + 1), instanceName);
    i->model = fmuType == fmi2ModelExchange;
    i->logging = loggingOn;
    for (int k = 0; k < N_CATEGORIES; k++) i->shown[k] = 1;
    start(i);
    i->now->v = 0.0;
    if (IS(LEAK)) memset(taken = malloc(1 << 16), 1, 1 << 16);
    const int second = IS(ONLY_ONCE) && made++ > 0;
    if (second || (!IS(ANY_GUID) && strcmp(fmuGUID, IS(OTHER_GUID) ? "{other}" : MODEL_GUID))) {
        say(i, fmi2Error, "the library is not that of this GUID.");
        free(i->name);
        free(i);
        return NULL;
    }
    return i;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *i = c;
    if (i == NULL) return;
    if (IS(FREE_CRASH)) raise(SIGSEGV);
    free(i->name);
    free(i);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t n, const fmi2String names[]) {
    Instance *i = c;
    i->logging = loggingOn;
    for (int k = 0; k < N_CATEGORIES; k++) {
        i->shown[k] = n == 0;
        for (size_t j = 0; j < n; j++) i->shown[k] |= strcmp(names[j], CATEGORIES[k]) == 0;
    }
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *i = c;
    REQUIRE(i, INSTANTIATED);
    i->now->time = startTime;
    return fmi2OK;
}

#define CHANGE_PHASE(name, from, to)     \
    fmi2Status name(fmi2Component c) {   \
        Instance *i = c;                 \
        REQUIRE(i, from);                \
        i->now->phase = to;              \
        return fmi2OK;                   \
    }
CHANGE_PHASE(fmi2EnterInitializationMode, INSTANTIATED, INITIALIZATION)
CHANGE_PHASE(fmi2EnterEventMode, CONTINUOUS, RUNNING)
CHANGE_PHASE(fmi2EnterContinuousTimeMode, RUNNING, CONTINUOUS)

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Instance *i = c;
    REQUIRE(i, INITIALIZATION);
    if (IS(INITIALIZATION_ERROR) && !i->model) return REFUSE(i, "there are no consistent values.");
    if (IS(NOT_RESET_BY_ANYONE)) i->now->v += 0.01 * kept;
    i->now->moving = i->now->x > THRESHOLD;
    i->now->phase = RUNNING;
    return say(i, fmi2OK, "initialized at t = %g s", i->now->time);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    Instance *i = c;
    REQUIRE(i, RUNNING | CONTINUOUS);
    if (IS(TERMINATE_CRASH) && !i->model) raise(SIGSEGV);
    i->now->phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    start(c);
    return fmi2OK;
}

/* ---- get and set ----------------------------------------------------------------------- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real value[]) {
    Instance *i = c;
    for (size_t k = 0; k < n; k++) {
        if (r[k] >= N_REALS) return REFUSE(i, "there is no Real variable %u.", r[k]);
        value[k] = real(i, r[k]);
    }
    return fmi2OK;
}

static double *settable(Now *n, fmi2ValueReference r) {
    const int early = n->phase & (INSTANTIATED | INITIALIZATION);
    switch (r) {
        case U: return &n->u;
        case W: return &n->w;
        case GAIN: return early ? &n->gain : NULL;
        case X: return early ? &n->x : NULL;
        case V: return early ? &n->v : NULL;
        default: return NULL;
    }
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real value[]) {
    Instance *i = c;
    REQUIRE(i, INSTANTIATED | INITIALIZATION | RUNNING | CONTINUOUS);
    for (size_t k = 0; k < n; k++) {
        double *place = settable(i->now, r[k]);
        if (place == NULL) return REFUSE(i, "the Real variable %u cannot be set now.", r[k]);
        if (!isfinite(value[k]) && IS(NAN_CRASH)) raise(SIGSEGV);
        if (!isfinite(value[k]) && !IS(NAN_ACCEPTED))
            return say(i, fmi2Discard, "%g is no value of the Real variable %u.", value[k], r[k]);
        *place = value[k];
        i->now->last_set = (int)r[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean value[]) {
    Instance *i = c;
    for (size_t k = 0; k < n; k++) {
        if (r[k] != 0) return REFUSE(i, "there is no Boolean variable %u.", r[k]);
        value[k] = i->now->phase == INITIALIZATION ? i->now->x > THRESHOLD : i->now->moving;
    }
    return fmi2OK;
}

#define WITHOUT(type)                                                                                 \
    fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##type v[]) { \
        Instance *i = c;                                                                              \
        return n == 0 ? fmi2OK : REFUSE(i, "no variable of this type can be set.");                   \
    }
#define WITHOUT_GET(type)                                                                             \
    fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##type v[]) {  \
        Instance *i = c;                                                                              \
        return n == 0 ? fmi2OK : REFUSE(i, "there is no variable of this type.");                     \
    }
WITHOUT(Integer)
WITHOUT(Boolean)
WITHOUT(String)
WITHOUT_GET(Integer)
WITHOUT_GET(String)

/* ---- states ---------------------------------------------------------------------------- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    const Instance *i = c;
    if (*state == NULL || IS(STATE_NOT_REUSED)) *state = malloc(sizeof(Now));
    memcpy(*state, i->now, sizeof(Now));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    Instance *i = c;
    const double x = i->now->x;
    memcpy(i->now, state, sizeof(Now));
    if (IS(NOT_RESTORED)) i->now->x = x;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!strcmp(((Instance *)c)->fault, "FREE_STATE_CRASH")) raise(SIGSEGV);
    free(*state);
    *state = NULL;
    return fmi2OK;
}

static unsigned sum(const Now *now) {
    const unsigned char *bytes = (const unsigned char *)now;
    unsigned hash = 2166136261U;
    for (size_t k = 0; k < sizeof *now; k++) hash = (hash ^ bytes[k]) * 16777619U;
    return hash;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    const Instance *i = c;
    *size = IS(STATE_SIZE) ? (size_t)1 << 60 : IS(STATE_EMPTY) ? 0 : sizeof(Bytes);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    Instance *i = c;
    Bytes whole;
    if (size < sizeof whole) return REFUSE(i, "there is no room for a state.");
    memset(&whole, 0, sizeof whole);
    memcpy(&whole.now, state, sizeof(Now));
    if (IS(NOT_SERIALIZED)) whole.now.v = 0.0;
    whole.magic = MAGIC;
    whole.check = sum(&whole.now);
    memcpy(bytes, &whole, sizeof whole);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    Instance *i = c;
    Bytes whole;
    if (size != sizeof whole) return REFUSE(i, "%u bytes are no state.", (unsigned)size);
    memcpy(&whole, bytes, sizeof whole);
    if (whole.magic != MAGIC || whole.check != sum(&whole.now)) {
        if (IS(DAMAGED_CRASH)) raise(SIGSEGV);
        return REFUSE(i, "these bytes are no state.");
    }
    if (*state == NULL) *state = malloc(sizeof(Now));
    memcpy(*state, &whole.now, sizeof(Now));
    return fmi2OK;
}

/* ---- derivatives ----------------------------------------------------------------------- */

static double partial(const Instance *i, fmi2ValueReference unknown, fmi2ValueReference known) {
    const double by_u = IS(DERIVATIVE) ? 1.05 * i->now->gain : i->now->gain;
    if (unknown == ACCELERATION || unknown == DER_V)
        return known == U ? by_u : known == X ? -K : known == V ? -C : known == GAIN ? i->now->u : 0.0;
    if (unknown == TOTAL) return known == W ? 0.5 : known == X ? 1.0 : 0.0;
    if (unknown == POSITION) return known == X;
    return (unknown == SPEED || unknown == DER_X) && known == V;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n,
                                        const fmi2ValueReference knowns[], size_t m, const fmi2Real seed[],
                                        fmi2Real value[]) {
    Instance *i = c;
    REQUIRE(i, INITIALIZATION | RUNNING | CONTINUOUS);
    if (IS(DERIVATIVE_CRASH)) raise(SIGSEGV);
    for (size_t k = 0; k < n; k++) {
        value[k] = 0.0;
        for (size_t j = 0; j < m; j++) value[k] += partial(i, unknowns[k], knowns[j]) * seed[j];
    }
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    Instance *i = c;
    return REFUSE(i, "inputs are held over a step.");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    const Instance *i = c;
    const double v = i->now->v, a = acceleration(i, i->now->x, v);
    for (size_t k = 0; k < n; k++) {
        value[k] = order[k] > 1 ? 0.0 : r[k] == SPEED ? a : r[k] == ACCELERATION ? -K * v - C * a : v;
        if (IS(OUTPUT_DERIVATIVE)) value[k] = 2.0 * value[k] + 10.0;
    }
    return fmi2OK;
}

/* ---- co-simulation --------------------------------------------------------------------- */

typedef double Reading(const volatile double *block, double before);

/* Allocates blocks, reads what `reading` says of each, and frees them. One block could be the same in all runs: the C
 * library returns the last one that anybody freed. It cannot have so many of a size at hand. */
static double use_memory(Reading *reading) {
    void *volatile blocks[BLOCKS];
    double found = 0.0;
    for (int k = 0; k < BLOCKS; k++) blocks[k] = malloc(40);
    for (int k = 0; k < BLOCKS; k++) found = reading(blocks[k], found);
    for (int k = 0; k < BLOCKS; k++) free(blocks[k]);
    return found;
}

/* A number from 0 to 1 that is another one for each sequence of addresses. */
static double hash_address(const volatile double *block, double before) {
    return fmod(before * 1021.0 + (double)((uintptr_t)block % 65521U) / 65521.0, 1.0);
}

static double add_content(const volatile double *block, double before) {
    const double content = block[3]; /* the C library has pointers at the start of what is free */
    return fabs(content) < 100.0 ? before + content : before;
}

/* What a step does that it should not. */
static fmi2Status misbehave(Instance *i) {
    Now *n = i->now;
    struct timespec now;
    if (IS(SEGFAULT)) raise(SIGSEGV);
    if (IS(EXIT)) exit(0);
    if (IS(ABORT)) abort();
    while (IS(HANG)) spins++;
    if (IS(NAN_LATER) || IS(INFINITE_LATER)) n->poison = 1;
    if (IS(NEGATIVE_STATUS)) return (fmi2Status)-1;
    if (IS(PENDING)) return fmi2Pending;
    if (IS(ASKS_TO_END)) {
        i->terminates = 1;
        return say(i, fmi2Discard, "it is over at t = %g s.", n->time);
    }
    if (IS(CLOCK)) {
        clock_gettime(CLOCK_REALTIME, &now);
        n->v += 1e-6 * ((double)now.tv_nsec / 1e9);
    }
    if (IS(SECONDS)) n->v += 1e-8 * (double)(time(NULL) % 101);
    if (IS(ADDRESS)) n->v += 1e-3 * use_memory(hash_address);
    if (IS(UNINITIALIZED)) n->v += 1e-6 * use_memory(add_content);
    if (IS(MEMORY)) {
        if ((taken = malloc(1 << 24)) == NULL) return REFUSE(i, "out of memory.");
        memset(taken, 1, 1 << 24);
    }
    if (IS(NOT_RESET_BY_ANYONE)) kept = 1.0;
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean noReturn) {
    Instance *i = c;
    Now *n = i->now;
    if (IS(PHASE_CRASH) && n->phase == INSTANTIATED) raise(SIGSEGV);
    if (IS(PHASE_ACCEPTED) && n->phase == TERMINATED) return fmi2OK;
    REQUIRE(i, RUNNING);
    if (!(length > 0.0) || fabs(time - n->time) > 1e-6 * length)
        return REFUSE(i, "a step from t = %g s by %g s is none.", time, length);
    if (i->first_step == 0.0) i->first_step = length;
    if (IS(SPLIT_REFUSED) && length < 0.0099) return REFUSE(i, "the step size is 0.01 s.");
    if (IS(PRINTS)) printf("a step to t = %g s\n", time + length);
    if (IS(SLOW)) usleep(50000);
    if (IS(THREADS)) {
        scratch = n->v;
        for (int k = 0; k < 50 && scratch == n->v; k++) usleep(20); /* until another thread writes there */
        n->v = scratch;
    }
    if (IS(ORDER) && n->last_set == U) n->v += 1e-3;
    if (IS(STEP_SIZE) && length < 0.0099) n->v *= 1.01;
    if (time + length > LATER) {
        const fmi2Status status = misbehave(i);
        if (status != fmi2OK) return status;
    }
    n->before[0] = n->time;
    n->before[1] = n->x;
    n->before[2] = n->v;
    integrate(i, length);
    n->time = time + length;
    n->moving = n->x > THRESHOLD;
    return say(i, fmi2OK, "a step to t = %g s", n->time);
}

fmi2Status fmi2CancelStep(fmi2Component c) { return REFUSE((Instance *)c, "no step is pending."); }

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((Instance *)c)->now->time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = ((Instance *)c)->terminates;
    return fmi2OK;
}

#define NO_STATUS(name, type) \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2StatusKind kind, type *value) { return fmi2Discard; }
NO_STATUS(Status, fmi2Status)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(StringStatus, fmi2String)

/* ---- model exchange -------------------------------------------------------------------- */

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    Instance *i = c;
    REQUIRE(i, RUNNING);
    memset(info, 0, sizeof *info);
    i->now->moving = i->now->x > THRESHOLD;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noReturn, fmi2Boolean *enterEventMode,
                                       fmi2Boolean *terminateSimulation) {
    Instance *i = c;
    REQUIRE(i, CONTINUOUS);
    *enterEventMode = *terminateSimulation = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    Instance *i = c;
    REQUIRE(i, RUNNING | CONTINUOUS);
    i->now->time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx) {
    Instance *i = c;
    REQUIRE(i, CONTINUOUS);
    i->now->x = x[0];
    i->now->v = x[1];
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx) {
    Instance *i = c;
    REQUIRE(i, INITIALIZATION | RUNNING | CONTINUOUS);
    if (IS(MODEL_CRASH)) raise(SIGSEGV);
    derivatives[0] = real(i, DER_X);
    derivatives[1] = real(i, DER_V);
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t ni) {
    indicators[0] = ((Instance *)c)->now->x - THRESHOLD;
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx) {
    x[0] = real(c, X);
    x[1] = real(c, V);
    return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t nx) {
    nominals[0] = nominals[1] = 0.1;
    return fmi2OK;
}
