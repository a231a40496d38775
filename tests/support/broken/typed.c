/* An FMI 2.0 FMU for co-simulation that is as it should be, with variables of all types:
 *
 *     x' = k u - d x,   y = x + u / 2 while on,   sum = n + m,   flag = on and not latch,   text = name.
 *
 * A number in resources/fault.txt makes one thing of it wrong; see `TypedFault` in typed.py.
 */
#define _GNU_SOURCE
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "typed_faults.h"

enum { U, W, K, D, X, DER_X, Y, N_REALS };
enum { N, M, MODE_IN, SUM, MODE, N_INTEGERS };
enum { ON, LATCH, FLAG, N_BOOLEANS };
enum { NAME, TEXT, N_STRINGS };
enum { INSTANTIATED, INITIALIZATION, RUNNING, TERMINATED };

#define SUBSTEP 1e-3 /* s, of the integration */
#define LONGEST 64   /* characters of a String */

typedef struct {
    double time, slope, r[N_REALS];
    int i[N_INTEGERS], b[N_BOOLEANS];
    char name[LONGEST];
} Now;

typedef struct {
    Now now;
    int fault, phase;
    char *instance, resources[512], text[LONGEST];
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
} Instance;

static Now kept; /* what faults let instances share */

static fmi2Status refuse(const Instance *i, const char *text) {
    i->logger(i->environment, i->instance, fmi2Error, "logStatusError", text);
    return fmi2Error;
}

#define REQUIRE(i, when) \
    if ((i)->phase != (when)) return refuse((i), "This call does not belong in this phase.")

/* ---- equations ------------------------------------------------------------------------- */

static double slope(const Instance *i, double u, double x) {
    const double *r = i->now.r;
    return r[K] * u - r[D] * x;
}

static void calculate(Instance *i) {
    Now *n = &i->now;
    const double u = i->fault == INPUT_IGNORED ? 0.0 : n->r[U];
    n->r[DER_X] = slope(i, u, n->r[X]);
    n->r[Y] = n->r[X] + (n->b[ON] ? 0.5 * u : 0.0) + n->r[W];
    n->i[SUM] = n->i[N] + n->i[M];
    n->i[MODE] = i->fault == ENUMERATION_OUTSIDE && n->time > 0.5 ? 7 : n->i[MODE_IN];
    n->b[FLAG] = n->b[ON] && !n->b[LATCH];
    if (i->fault == BOOLEAN_42 && n->b[FLAG]) n->b[FLAG] = 42;
}

static void integrate(Instance *i, double length) {
    Now *n = &i->now;
    const int count = (int)ceil(length / SUBSTEP - 1e-6);
    const double h = length / count, way = i->fault == INPUT_SIGN ? -1.0 : 1.0;
    for (int k = 0; k < count; k++) {
        const double u = i->fault == INPUT_IGNORED ? 0.0 : way * (n->r[U] + n->slope * (k + 0.5) * h);
        const double half = n->r[X] + 0.5 * h * slope(i, u, n->r[X]);
        n->r[X] += h * slope(i, u, half);
    }
    n->r[U] += n->slope * length;
    n->slope = 0.0;
}

/* ---- instances ------------------------------------------------------------------------- */

static void start(Instance *i) {
    Now *n = &i->now;
    const Now before = *n;
    i->phase = INSTANTIATED;
    memset(n, 0, sizeof *n);
    n->r[K] = i->fault == START_REAL ? 2.5 : 2.0;
    n->r[D] = 1.0;
    n->r[X] = i->fault == START_STATE ? 0.6 : 0.5;
    n->i[N] = 1;
    n->i[M] = i->fault == START_INTEGER ? 4 : 3;
    n->i[MODE_IN] = 1;
    n->b[ON] = 1;
    n->b[LATCH] = i->fault == START_BOOLEAN;
    strcpy(n->name, i->fault == START_STRING ? "other" : "block");
    if (i->fault == RESET_KEEPS_PARAMETER && before.r[K] != 0.0) n->r[K] = before.r[K];
    if (i->fault == RESET_KEEPS_STRING && before.name[0]) strcpy(n->name, before.name);
    if (i->fault == RESET_KEEPS_INPUT && before.name[0]) n->i[N] = before.i[N];
    kept.r[K] = n->r[K];
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return COMPILED_VERSION; }

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    const char *folder = fmuResourceLocation + (strncmp(fmuResourceLocation, "file://", 7) ? 0 : 7);
    Instance *i;
    if (strcmp(fmuGUID, MODEL_GUID) != 0) return NULL;
    i = calloc(1, sizeof *i);
    snprintf(i->resources, sizeof i->resources, "%s", folder);
    i->fault = read_fault(i->resources);
    i->instance = strdup(instanceName);
    i->logger = functions->logger;
    i->environment = functions->componentEnvironment;
    start(i);
    calculate(i);
    misbehave_at_instantiation(i->fault);
    return i;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *i = c;
    if (i == NULL) return;
    free(i->instance);
    free(i);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t n, const fmi2String names[]) {
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *i = c;
    REQUIRE(i, INSTANTIATED);
    i->now.time = startTime;
    return fmi2OK;
}

static fmi2Status advance(Instance *i) {
    calculate(i);
    i->phase++;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    REQUIRE((Instance *)c, INSTANTIATED);
    return advance(c);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    REQUIRE((Instance *)c, INITIALIZATION);
    return advance(c);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    REQUIRE((Instance *)c, RUNNING);
    return advance(c);
}

fmi2Status fmi2Reset(fmi2Component c) {
    start(c);
    calculate(c);
    return fmi2OK;
}

/* ---- get and set ----------------------------------------------------------------------- */

#define GET(type, count, value)                                                                        \
    fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##type v[]) {  \
        Instance *i = c;                                                                              \
        calculate(i);                                                                                 \
        for (size_t k = 0; k < n; k++) {                                                              \
            if (r[k] >= (count)) return refuse(i, "There is no variable of this reference.");         \
            v[k] = value;                                                                             \
        }                                                                                             \
        return fmi2OK;                                                                                \
    }
#define SET(type, count, settable, assign)                                                            \
    fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##type v[]) { \
        Instance *i = c;                                                                              \
        for (size_t k = 0; k < n; k++) {                                                              \
            if (r[k] >= (count) || !(settable)) return refuse(i, "This variable cannot be set.");     \
            if (i->fault == INPUT_IGNORED) continue;                                                  \
            assign;                                                                                   \
        }                                                                                             \
        return fmi2OK;                                                                                \
    }

GET(Real, N_REALS, i->fault == SHARED_PARAMETER && r[k] == K ? kept.r[K] : i->now.r[r[k]])
GET(Integer, N_INTEGERS, i->now.i[r[k]])
GET(Boolean, N_BOOLEANS, i->now.b[r[k]])
GET(String, N_STRINGS, r[k] == NAME ? i->now.name : misbehave_with_text(i->fault, strcpy(i->text, i->now.name)))
SET(Real, N_REALS, (r[k] < K || r[k] == D || (r[k] <= X && i->phase < RUNNING)) && isfinite(v[k]), i->now.r[r[k]] = v[k]; if (r[k] == K) kept.r[K] = v[k])
SET(Integer, N_INTEGERS, r[k] <= MODE_IN, i->now.i[r[k]] = v[k])
SET(Boolean, N_BOOLEANS, r[k] <= LATCH, i->now.b[r[k]] = v[k] != 0)
SET(String, N_STRINGS, r[k] == NAME && strlen(v[k]) < LONGEST, strcpy(i->now.name, v[k]))

/* ---- states ---------------------------------------------------------------------------- */

static void restore(Instance *i, const Now *saved) {
    const Now now = i->now;
    i->now = *saved;
    if (i->fault == STATE_FORGETS_TUNABLE) i->now.r[D] = now.r[D];
    if (i->fault == STATE_FORGETS_BOOLEAN) i->now.b[LATCH] = now.b[LATCH];
    if (i->fault == STATE_FORGETS_STRING) strcpy(i->now.name, now.name);
    if (i->fault == STATE_FORGETS_INPUT) i->now.i[N] = now.i[N];
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (*state == NULL) *state = malloc(sizeof(Now));
    memcpy(*state, &((Instance *)c)->now, sizeof(Now));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    restore(c, state);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    free(*state);
    if (((Instance *)c)->fault != STATE_POINTER_KEPT) *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    *size = sizeof(Now);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    memcpy(bytes, state, sizeof(Now));
    if (((Instance *)c)->fault == BYTES_FORGET_TUNABLE) ((Now *)(void *)bytes)->r[D] = 1.0;
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(Now)) return refuse(c, "These bytes are no state.");
    if (*state == NULL) *state = malloc(sizeof(Now));
    memcpy(*state, bytes, sizeof(Now));
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n,
                                        const fmi2ValueReference knowns[], size_t m, const fmi2Real seed[],
                                        fmi2Real value[]) {
    return refuse(c, "There are no directional derivatives.");
}

/* ---- co-simulation --------------------------------------------------------------------- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    Instance *i = c;
    for (size_t k = 0; k < n; k++) {
        if (r[k] > W || order[k] != 1) return refuse(i, "Only first derivatives of inputs can be set.");
        if (r[k] == U && i->fault != INTERPOLATION_IGNORED) i->now.slope = value[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    return refuse(c, "There are no derivatives of outputs.");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean noReturn) {
    Instance *i = c;
    REQUIRE(i, RUNNING);
    misbehave_in_a_step(i->fault, i->resources);
    if (i->fault == STEP_DOES_NOTHING) return fmi2OK;
    integrate(i, length);
    i->now.time = time + length;
    calculate(i);
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c) { return refuse(c, "No step is pending."); }

#define NO_STATUS(name, type)                                                                    \
    fmi2Status fmi2Get##name(fmi2Component c, const fmi2StatusKind kind, type *value) {             \
        return fmi2Discard;                                                                      \
    }
NO_STATUS(Status, fmi2Status)
NO_STATUS(RealStatus, fmi2Real)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(BooleanStatus, fmi2Boolean)
NO_STATUS(StringStatus, fmi2String)
