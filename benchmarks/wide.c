/* An FMI 2.0 FMU with as many variables as N says, for co-simulation. Value references are positions in `real`:
 *
 *     inputs u, parameters k, outputs y, states x, derivatives of x, and locals, with
 *     y = k u + x[0],   x' = u - x,   locals = 0.5 y[0].
 */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define TENTH (N / 10)
enum { U = 0, K = TENTH, Y = 2 * TENTH, X = 3 * TENTH, DX = X + STATES, LOCAL = DX + STATES };

typedef struct {
    fmi2CallbackFunctions host;
    fmi2ComponentEnvironment environment;
    int is_stale;
    double real[N];
} Model;

static void reset(Model *m) {
    memset(m->real, 0, sizeof m->real);
    for (int i = 0; i < TENTH; i++) m->real[K + i] = 2.0;
    for (int i = 0; i < STATES; i++) m->real[X + i] = 1.0;
    m->is_stale = 1;
}

static void compute(Model *m) {
    double *r = m->real;
    if (!m->is_stale) return;
    for (int i = 0; i < TENTH; i++) r[Y + i] = r[K + i] * r[U + i] + r[X];
    for (int i = 0; i < STATES; i++) r[DX + i] = r[U + i] - r[X + i];
    for (int i = LOCAL; i < N; i++) r[i] = 0.5 * r[Y];
    m->is_stale = 0;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging) {
    Model *m = strcmp(guid, MODEL_GUID) == 0 && type == fmi2CoSimulation ? calloc(1, sizeof *m) : NULL;
    if (m != NULL) m->host = *host, m->environment = host->componentEnvironment, reset(m);
    return m;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return reset(c), fmi2OK; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2Real values[]) {
    Model *m = c;
    compute(m);
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= N) return fmi2Error;
        values[i] = m->real[references[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Real values[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) {
        if (references[i] >= N) return fmi2Error;
        m->real[references[i]] = values[i];
    }
    m->is_stale = 1;
    return fmi2OK;
}

#define NOTHING(kind) \
    fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference v[], size_t n, fmi2##kind values[]) { \
        return n ? fmi2Error : fmi2OK; \
    } \
    fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference v[], size_t n, const fmi2##kind values[]) { \
        return n ? fmi2Error : fmi2OK; \
    }
NOTHING(Integer)
NOTHING(Boolean)
NOTHING(String)

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_set) {
    Model *m = c;
    double *r = m->real;
    for (int i = 0; i < STATES; i++) {
        const double slope = r[U + i] - r[X + i];
        r[X + i] += step * (slope - 0.5 * step * slope + step * step * slope / 6.0);
    }
    m->is_stale = 1;
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (*state == NULL) *state = malloc(sizeof(Model));
    memcpy(*state, c, sizeof(Model));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { return memcpy(c, state, sizeof(Model)), fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) { return free(*state), *state = NULL, fmi2OK; }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    return *size = sizeof ((Model *)0)->real, fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return memcpy(bytes, ((Model *)state)->real, size), fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    Model *m = *state = malloc(sizeof(Model));
    memcpy(m, c, sizeof *m);
    memcpy(m->real, bytes, size);
    return m->is_stale = 1, fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real values[]) {
    Model *m = c;
    double *direction = calloc(N, sizeof *direction);
    for (size_t i = 0; i < n_knowns; i++) direction[knowns[i]] = seed[i];
    for (size_t i = 0; i < n_unknowns; i++) {
        const unsigned v = unknowns[i];
        const unsigned of = v >= Y && v < X ? v - Y : 0;
        const double y = m->real[K + of] * direction[U + of] + m->real[U + of] * direction[K + of] + direction[X];
        values[i] = v >= LOCAL ? 0.5 * y : v >= DX ? direction[U + v - DX] - direction[X + v - DX] : y;
    }
    free(direction);
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference v[], size_t n,
                                       const fmi2Integer order[], const fmi2Real values[]) { return fmi2Error; }
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference v[], size_t n,
                                        const fmi2Integer order[], fmi2Real values[]) { return fmi2Error; }
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) { return fmi2Discard; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) { return fmi2Discard; }
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind k, fmi2Integer *value) { return fmi2Discard; }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean *value) { return fmi2Discard; }
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) { return fmi2Discard; }
