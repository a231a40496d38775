/* A Model Exchange FMU: x' = u - x, a bouncing ball (state events), a stair of 0.1 s (time events), and a reset of x
   by step events; y = x + gain u. It refuses calls in modes where the standard does not allow them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { X, H, V, U = 6, STAIR, RESETS, LIMIT, END, FAILS, GAIN, Y, COUNT };
enum { BEFORE, EVENT, CONTINUOUS };
#define CHECK(mode_) \
    if (((Model *)c)->mode != (mode_)) return fmi2Error

typedef struct {
    double value[COUNT], time, next;
    int mode;
} Model;

static const double start[COUNT] = {[X] = 1, [H] = 1, [LIMIT] = 1e9, [END] = 1e9, [FAILS] = 1e9};

static void begin(Model *m) {
    memset(m, 0, sizeof *m);
    memcpy(m->value, start, sizeof start);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    Model *m = type == fmi2ModelExchange && !strcmp(guid, MODEL_GUID) ? malloc(sizeof *m) : NULL;
    if (m) begin(m);
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean known, fmi2Real tolerance, fmi2Real time, fmi2Boolean ends,
                               fmi2Real end) {
    Model *m = c;
    m->time = time;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Model *m = c;
    m->mode = EVENT;
    m->next = m->time + 0.1;
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    begin(c);
    return fmi2OK;
}

static double get(const Model *m, fmi2ValueReference r) {
    switch (r) {
        case 3: return m->time >= m->value[FAILS] ? NAN : m->value[U] - m->value[X];
        case 4: return m->value[V];
        case 5: return -9.81;
        case Y: return m->value[X] + m->value[GAIN] * m->value[U];
        default: return m->value[r];
    }
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real values[]) {
    for (size_t i = 0; i < n; i++) values[i] = get(c, r[i]);
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) {
        if (m->mode != BEFORE && r[i] != U) return fmi2Error;
        m->value[r[i]] = values[i];
    }
    return fmi2OK;
}
#define NO_VALUES(Type) \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##Type values[]) { \
        return n ? fmi2Error : fmi2OK; \
    } \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##Type values[]) { \
        return n ? fmi2Error : fmi2OK; \
    }
NO_VALUES(Integer)
NO_VALUES(Boolean)
NO_VALUES(String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!*state) *state = malloc(sizeof(Model));
    memcpy(*state, c, sizeof(Model));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(c, state, sizeof(Model));
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    free(*state);
    *state = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    *size = sizeof(Model);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    memcpy(bytes, state, sizeof(Model));
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    *state = malloc(sizeof(Model));
    memcpy(*state, bytes, sizeof(Model));
    return fmi2OK;
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference z[], size_t nz,
                                        const fmi2ValueReference v[], size_t nv, const fmi2Real dv[], fmi2Real dz[]) {
    return fmi2Error;
}

fmi2Status fmi2EnterEventMode(fmi2Component c) {
    CHECK(CONTINUOUS);
    ((Model *)c)->mode = EVENT;
    return fmi2OK;
}
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    CHECK(EVENT);
    Model *m = c;
    double *s = m->value;
    int changed = 0;
    if (s[H] <= 0 && s[V] < 0) s[H] = 0, s[V] *= -0.7, changed = 1;
    if (m->time >= m->next) s[STAIR] += 1, m->next = m->next + 0.1, changed = 1;
    if (s[X] > s[LIMIT]) s[X] = 0, s[RESETS] += 1, changed = 1;
    info->newDiscreteStatesNeeded = changed;
    info->terminateSimulation = s[END] >= 0 && s[STAIR] >= s[END];
    info->nominalsOfContinuousStatesChanged = 0;
    info->valuesOfContinuousStatesChanged = changed;
    info->nextEventTimeDefined = 1;
    info->nextEventTime = s[END] < 0 ? NAN : m->next; /* a fault */
    return fmi2OK;
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    CHECK(EVENT);
    ((Model *)c)->mode = CONTINUOUS;
    return fmi2OK;
}
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean final, fmi2Boolean *enter, fmi2Boolean *end) {
    CHECK(CONTINUOUS);
    Model *m = c;
    *enter = m->value[X] > m->value[LIMIT];
    *end = 0;
    return fmi2OK;
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    CHECK(CONTINUOUS);
    ((Model *)c)->time = time;
    return fmi2OK;
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    CHECK(CONTINUOUS);
    memcpy(((Model *)c)->value, x, n * sizeof *x);
    return fmi2OK;
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    memcpy(x, ((Model *)c)->value, n * sizeof *x);
    return fmi2OK;
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n) {
    for (size_t i = 0; i < n; i++) dx[i] = get(c, (fmi2ValueReference)(3 + i));
    return fmi2OK;
}
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n) {
    if (n) z[0] = ((Model *)c)->value[H];
    return fmi2OK;
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t n) {
    for (size_t i = 0; i < n; i++) nominal[i] = 1.0;
    return fmi2OK;
}
