/* An FMI 2.0 co-simulation FMU with outputs and locals of all types. All follow from time t and input u:
 *
 * x = integral of u, half = x / 2, count = first + whole tenths of a second, twice = 2 count,
 * high = x > 0.25 (returned as 7, which counts as true), odd = count is odd, mode = 1, 2 or 4,
 * text = "count is ..., high|low", note = a text with a quote, a comma, a line break and UTF-8.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { U, X, HALF };                                                       /* Reals */
enum { FIRST, COUNT, TWICE, MODE, CRASH_AT, FAIL_AT, READS };             /* Integers and Enumerations */
enum { HIGH, ODD, ON };                                                    /* Booleans */
enum { TEXT, NOTE };                                                       /* Strings */

typedef struct {
    double u, x, time;
    int first, crash_at, fail_at, on;
} State;

typedef struct {
    State now;
    int reads; /* calls that read Strings, which no state keeps */
    char text[80];
} Instance;

static const State start = {.u = 1.0, .crash_at = -1, .fail_at = -1};

static int count(const State *now) { return now->first + (int)floor(now->time / 0.1 + 1e-6); }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *calls, fmi2Boolean visible, fmi2Boolean logging) {
    if (strcmp(guid, MODEL_GUID) != 0) return NULL;
    Instance *it = calloc(1, sizeof(Instance));
    it->now = start;
    return it;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real begin,
                               fmi2Boolean ends, fmi2Real end) {
    ((Instance *)c)->now.time = begin;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    ((Instance *)c)->now = start;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
    const State *now = &((Instance *)c)->now;
    for (size_t i = 0; i < n; i++) v[i] = r[i] == U ? now->u : r[i] == X ? now->x : now->x / 2.0;
    return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer v[]) {
    const State *now = &((Instance *)c)->now;
    const int whole = count(now);
    if (now->fail_at >= 0 && whole >= now->fail_at) return fmi2Error;
    for (size_t i = 0; i < n; i++) {
        switch (r[i]) {
        case FIRST: v[i] = now->first; break;
        case COUNT: v[i] = whole; break;
        case TWICE: v[i] = 2 * whole; break;
        case MODE: v[i] = now->x < 0.2 ? 1 : now->x < 0.4 ? 2 : 4; break;
        case CRASH_AT: v[i] = now->crash_at; break;
        case READS: v[i] = ((Instance *)c)->reads; break;
        default: v[i] = now->fail_at;
        }
    }
    return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean v[]) {
    const State *now = &((Instance *)c)->now;
    for (size_t i = 0; i < n; i++) v[i] = r[i] == HIGH ? 7 * (now->x > 0.25) : r[i] == ODD ? count(now) % 2 : now->on;
    return fmi2OK;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String v[]) {
    Instance *it = c;
    it->reads++;
    snprintf(it->text, sizeof it->text, "count is %d, %s", count(&it->now), it->now.x > 0.25 ? "high" : "low");
    for (size_t i = 0; i < n; i++) v[i] = r[i] == TEXT ? it->text : "a \"quote\", a comma,\na line, \xc3\xa9";
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
    for (size_t i = 0; i < n; i++)
        if (r[i] == U) ((Instance *)c)->now.u = v[i];
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer v[]) {
    State *now = &((Instance *)c)->now;
    for (size_t i = 0; i < n; i++) {
        if (r[i] == FIRST) now->first = v[i];
        if (r[i] == CRASH_AT) now->crash_at = v[i];
        if (r[i] == FAIL_AT) now->fail_at = v[i];
    }
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean v[]) {
    for (size_t i = 0; i < n; i++) ((Instance *)c)->now.on = v[i];
    return fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String v[]) { return fmi2OK; }

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keep) {
    State *now = &((Instance *)c)->now;
    if (now->crash_at >= 0 && count(now) >= now->crash_at) abort();
    now->x += step * now->u;
    now->time = time + step;
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s) {
    if (*s == NULL) *s = malloc(sizeof(State));
    memcpy(*s, &((Instance *)c)->now, sizeof(State));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) {
    memcpy(&((Instance *)c)->now, s, sizeof(State));
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) {
    free(*s);
    *s = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *size) {
    *size = sizeof(State);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte bytes[], size_t size) {
    memcpy(bytes, s, size);
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *s) {
    *s = malloc(sizeof(State));
    memcpy(*s, bytes, size);
    return fmi2OK;
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference z[], size_t nz,
                                        const fmi2ValueReference k[], size_t nk, const fmi2Real dk[], fmi2Real dz[]) {
    return fmi2Error;
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real v[]) {
    return fmi2Error;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real v[]) {
    return fmi2Error;
}
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status *v) { return fmi2Discard; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real *v) { return fmi2Discard; }
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind k, fmi2Integer *v) { return fmi2Discard; }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean *v) { return fmi2Discard; }
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind k, fmi2String *v) { return fmi2Discard; }
