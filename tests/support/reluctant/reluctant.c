/* An FMI 2.0 co-simulation FMU that integrates its input: x' = gain u.
 *
 * As FMUs of 20-sim do, it sets all variables back in fmi2SetupExperiment, and does not in fmi2Reset. If
 * `stubborn` is true it does not take other start values at all. It limits `share`, and keeps `angle`
 * in degrees. From the time `slow_from` on each step takes `pause` seconds. It rejects a huge `gain` or
 * `share` with fmi2Error, and all further values, too. After a huge `guess` it answers reading with
 * fmi2Fatal, and aborts if it is called again.
 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi2Functions.h"

enum { U, GAIN, SHARE, ANGLE, SLOW_FROM, PAUSE, X, GUESS, TOLERANCE, REALS };
#define DEGREE (3.14159265358979323846 / 180.0)
#define HUGE_VALUE 1e200

typedef struct {
    double reals[REALS];
    int integers[2];
    int stubborn;
    int failed;
    char label[64];
} Instance;

static void set_back(Instance *instance) {
    const Instance first = {{1.0, 1.0, 0.5, 0.0, 1e300}, {1, 1}, 0, 0, "none"};
    *instance = first;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    Instance *instance = calloc(1, sizeof *instance);
    if (instance != NULL) set_back(instance);
    return instance;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *instance = c;
    const double x = instance->reals[X];
    set_back(instance);
    instance->reals[X] = x; /* which fmi2Reset leaves as it is, too */
    instance->reals[TOLERANCE] = toleranceDefined ? tolerance : 0.0;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Instance *instance = c;
    double *reals = instance->reals;
    if (instance->stubborn) {
        const double tolerance = reals[TOLERANCE];
        set_back(instance);
        instance->stubborn = 1, reals[TOLERANCE] = tolerance;
    }
    reals[SHARE] = fmin(fmax(reals[SHARE], 0.0), 1.0);
    instance->failed = reals[GUESS] > HUGE_VALUE;
    reals[GUESS] = 42.0;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Instance *instance = c;
    if (instance->failed && instance->failed++ > 1) abort();
    if (instance->failed) return fmi2Fatal;
    for (size_t i = 0; i < n; i++)
        value[i] = vr[i] == ANGLE ? instance->reals[ANGLE] * DEGREE : instance->reals[vr[i]];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Instance *instance = c;
    for (size_t i = 0; i < n; i++) instance->failed |= (vr[i] == GAIN || vr[i] == SHARE) && value[i] > HUGE_VALUE;
    if (instance->failed) return fmi2Error;
    for (size_t i = 0; i < n; i++) instance->reals[vr[i]] = vr[i] == ANGLE ? value[i] / DEGREE : value[i];
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Instance *)c)->integers[vr[i]];
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++) ((Instance *)c)->integers[vr[i]] = value[i];
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Instance *)c)->stubborn;
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) ((Instance *)c)->stubborn = value[i] != fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Instance *)c)->label;
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
    for (size_t i = 0; i < n; i++) strncpy(((Instance *)c)->label, value[i], sizeof((Instance *)c)->label - 1);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    double *reals = ((Instance *)c)->reals;
    if (time >= reals[SLOW_FROM]) {
        const double whole = floor(reals[PAUSE]);
        struct timespec pause = {(time_t)whole, (long)(1e9 * (reals[PAUSE] - whole))};
        while (nanosleep(&pause, &pause) != 0) continue; /* a signal does not end the step */
    }
    reals[X] += step * reals[GAIN] * reals[U];
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (*state == NULL) *state = malloc(sizeof(Instance));
    memcpy(*state, c, sizeof(Instance));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(c, state, sizeof(Instance));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    free(*state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    *size = sizeof(Instance);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    memcpy(bytes, state, size);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    *state = malloc(size);
    memcpy(*state, bytes, size);
    return fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference z[], size_t nz,
                                        const fmi2ValueReference v[], size_t nv, const fmi2Real dv[],
                                        fmi2Real dz[]) { return fmi2Error; }
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[]) { return fmi2Error; }
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) { return fmi2Error; }
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) { return fmi2Discard; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) { return fmi2Discard; }
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) { return fmi2Discard; }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) { return fmi2Discard; }
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) { return fmi2Discard; }
