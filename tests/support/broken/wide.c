/* An FMI 2.0 FMU for co-simulation with variables of all types and variabilities, in which any one can be wrong:
 *
 *     x' = k u - d x,          y = x + u / 2 while on, + w,    sum = n + m + p,    count = number of steps,
 *     mode = mode_in,          mode_2 = mode_p,                flag = on and not latch,   flag_2 = enabled,
 *     text = name,             echo = label.
 *
 * resources/fault.txt has the name of a fault, and the variable that is wrong: its type and reference, "r3".
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { U, W, K, D, X, DER_X, Y, G, T, N_REALS };
enum { N, M, P, MODE_IN, MODE_P, SUM, MODE, MODE_2, COUNT, C_INTEGER, N_INTEGERS };
enum { ON, LATCH, ENABLED, FLAG, FLAG_2, C_BOOLEAN, N_BOOLEANS };
enum { LABEL, NAME, TAG, TEXT, ECHO, C_STRING, N_STRINGS };
enum { INSTANTIATED, INITIALIZATION, RUNNING, TERMINATED };

#define SUBSTEP 1e-3 /* s, of the integration */
#define LONGEST 32   /* characters of a String */

typedef struct {
    double r[N_REALS], slope[2];
    int i[N_INTEGERS], b[N_BOOLEANS];
    char s[N_STRINGS][LONGEST];
} Values;

typedef struct {
    Values now;
    int phase, steps;
    char *name;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
} Instance;

static const Values STARTS = {
    .r = {[K] = 2.0, [D] = 1.0, [X] = 0.5, [G] = 9.81},
    .i = {[N] = 1, [M] = 3, [P] = 5, [MODE_IN] = 1, [MODE_P] = 1, [C_INTEGER] = 7},
    .b = {[ON] = 1, [C_BOOLEAN] = 1},
    .s = {[LABEL] = "label", [NAME] = "block", [TAG] = "tag", [C_STRING] = "always"},
};

static char fault[40], target[8], folder[900];
static Values shared;
static int alive;

static int is(const char *name) { return strcmp(fault, name) == 0; }
static int wrong(const char *name, char type, int reference) {
    return target[0] == type && atoi(target + 1) == reference && is(name);
}

#include "wide_faults.h"

__attribute__((constructor)) static void load(void) {
    char path[1000];
    Dl_info found;
    FILE *file;
    if (!dladdr((void *)load, &found)) return;
    snprintf(folder, sizeof folder, "%s", found.dli_fname);
    for (int k = 0; k < 3; k++) *strrchr(folder, '/') = 0; /* the library, its platform, binaries */
    snprintf(path, sizeof path, "%s/resources/fault.txt", folder);
    if ((file = fopen(path, "r")) == NULL) return;
    if (fscanf(file, "%39s %7s", fault, target) < 1) fault[0] = 0;
    fclose(file);
    misbehave_at("load");
}

__attribute__((destructor)) static void unload(void) { misbehave_at("unload"); }

static fmi2Status refuse(const Instance *i, const char *text) {
    i->logger(i->environment, i->name, fmi2Error, "logStatusError", text);
    return fmi2Error;
}

#define REQUIRE(i, when) \
    if ((i)->phase != (when)) return refuse((i), "This call does not belong in this phase.")

/* Copies all values; with a fault, but for one variable. */
static void copy(Values *to, const Values *from, const char *forgets) {
    const Values before = *to;
    *to = *from;
    if (!is(forgets)) return;
    const int k = atoi(target + 1);
    if (target[0] == 'r') to->r[k] = before.r[k];
    if (target[0] == 'i') to->i[k] = before.i[k];
    if (target[0] == 'b') to->b[k] = before.b[k];
    if (target[0] == 's') memcpy(to->s[k], before.s[k], LONGEST);
}

/* ---- equations ------------------------------------------------------------------------- */

static void calculate(Instance *i) {
    Values *n = &i->now, v = *n; /* what is used, which a fault makes another one than what is set */
    copy(&v, n, "");
    if (is("unused")) {
        Values starts = STARTS;
        copy(&starts, n, "unused");
        v = starts;
    }
    if (is("unused_all")) {
        v = STARTS;
        v.r[X] = n->r[X];
    }
    n->r[DER_X] = v.r[K] * v.r[U] - v.r[D] * v.r[X];
    n->r[Y] = v.r[X] + (v.b[ON] ? 0.5 * v.r[U] : 0.0) + v.r[W];
    n->i[SUM] = v.i[N] + v.i[M] + v.i[P];
    n->i[MODE] = v.i[MODE_IN];
    n->i[MODE_2] = v.i[MODE_P];
    n->b[FLAG] = v.b[ON] && !v.b[LATCH];
    n->b[FLAG_2] = v.b[ENABLED];
    memcpy(n->s[TEXT], v.s[NAME], LONGEST);
    memcpy(n->s[ECHO], v.s[LABEL], LONGEST);
    hide_dependency(n);
}

static void integrate(Instance *i, double length) {
    Values *n = &i->now;
    const int count = (int)ceil(length / SUBSTEP - 1e-6);
    const int unused = is("unused_all") || (is("unused") && !strcmp(target, "r0"));
    const double h = length / count, used = unused ? 0.0 : is("sign") ? -1.0 : 1.0;
    for (int k = 0; k < count; k++) {
        const double u = used * (n->r[U] + (is("slope_unused") ? 0.0 : n->slope[0] * (k + 0.5) * h));
        const double half = n->r[X] + 0.5 * h * (n->r[K] * u - n->r[D] * n->r[X]);
        n->r[X] += h * (n->r[K] * u - n->r[D] * half);
    }
    n->slope[0] = n->slope[1] = 0.0;
}

/* ---- instances ------------------------------------------------------------------------- */

static void start(Instance *i) {
    copy(&i->now, &STARTS, i->name[0] && i->steps >= 0 ? "reset" : "");
    i->phase = INSTANTIATED;
    i->steps = 0;
    if (is("start")) change(&i->now);
    if (is("shared")) shared = i->now;
    calculate(i);
}

const char *fmi2GetTypesPlatform(void) {
    return fmi2TypesPlatform;
}
const char *fmi2GetVersion(void) {
    return is("version") ? target : is("version_null") ? NULL : fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    Instance *i;
    if (strcmp(fmuGUID, MODEL_GUID) != 0) return NULL;
    i = calloc(1, sizeof *i);
    i->name = strdup(instanceName);
    i->logger = functions->logger;
    i->environment = functions->componentEnvironment;
    i->steps = -1;
    start(i);
    alive++;
    misbehave_at("instantiate");
    return i;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *i = c;
    if (i == NULL) return;
    misbehave_at("free");
    alive--;
    free(i->name);
    free(i);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t n, const fmi2String names[]) {
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *i = c;
    REQUIRE(i, INSTANTIATED);
    i->now.r[T] = startTime;
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
    misbehave_at("initialize");
    return advance(c);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    REQUIRE((Instance *)c, RUNNING);
    misbehave_at("terminate");
    return advance(c);
}

fmi2Status fmi2Reset(fmi2Component c) {
    misbehave_at("reset");
    start(c);
    return fmi2OK;
}

/* ---- get and set ----------------------------------------------------------------------- */

#define GET(type, letter, count, field)                                                                \
    fmi2Status fmi2Get##type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##type v[]) { \
        Instance *i = c;                                                                               \
        for (size_t k = 0; k < n; k++) {                                                               \
            if (r[k] >= (count)) return refuse(i, "There is no such variable.");                       \
            calculate(i);                                                                              \
            v[k] = wrong("shared", letter[0], (int)r[k]) ? shared.field[r[k]] : i->now.field[r[k]];    \
            misbehave_with_value(letter[0], (int)r[k], &v[k], i->now.r[T]);                            \
        }                                                                                              \
        return fmi2OK;                                                                                 \
    }
#define SET(type, letter, settable, assign)                                                                   \
    fmi2Status fmi2Set##type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##type v[]) { \
        Instance *i = c;                                                                                      \
        const int early = i->phase <= INITIALIZATION;                                                         \
        for (size_t k = 0; k < n; k++) {                                                                      \
            if (!(settable)) return refuse(i, "This variable cannot be set now.");                            \
            Values *to = &i->now;                                                                             \
            if (!wrong("not_set", letter[0], (int)r[k])) assign;                                              \
            to = &shared;                                                                                     \
            assign;                                                                                           \
        }                                                                                                     \
        return fmi2OK;                                                                                        \
    }

GET(Real, "r", N_REALS, r)
GET(Integer, "i", N_INTEGERS, i)
GET(Boolean, "b", N_BOOLEANS, b)
GET(String, "s", N_STRINGS, s)
SET(Real, "r", (r[k] <= W || r[k] == D || (early && (r[k] == K || r[k] == X))) && isfinite(v[k]), to->r[r[k]] = v[k])
SET(Integer, "i", r[k] <= MODE_P && (early || r[k] != P), to->i[r[k]] = v[k])
SET(Boolean, "b", r[k] <= ENABLED && (early || r[k] != ENABLED), to->b[r[k]] = v[k] != 0)
SET(String, "s", r[k] <= TAG && (early || r[k] != TAG) && strlen(v[k]) < LONGEST, strcpy(to->s[r[k]], v[k]))

/* ---- states ---------------------------------------------------------------------------- */

typedef struct {
    Values now;
    int phase, steps;
} State;

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    Instance *i = c;
    if (*state == NULL) *state = malloc(sizeof(State));
    *(State *)*state = (State){i->now, i->phase, i->steps};
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    Instance *i = c;
    const State *saved = state;
    copy(&i->now, &saved->now, "state");
    i->phase = saved->phase;
    i->steps = saved->steps;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (*state == NULL && is("state_null_crash")) abort();
    free(*state);
    if (!is("state_kept")) *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    *size = sizeof(State);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    State copied = *(State *)state;
    Values values = STARTS;
    copy(&values, &copied.now, "bytes");
    copied.now = values;
    memcpy(bytes, &copied, size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (size != sizeof(State)) return refuse(c, "These bytes are no state.");
    if (*state == NULL) *state = calloc(1, sizeof(State));
    memcpy(*state, bytes, size);
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
        i->now.slope[r[k]] = value[k];
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
    misbehave_at("step");
    if (is("step_nothing")) return fmi2OK;
    i->steps++;
    integrate(i, length * (is("step_double") ? 2.0 : 1.0));
    i->now.r[T] = time + length;
    i->now.i[COUNT]++;
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
