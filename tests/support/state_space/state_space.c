/* An FMI 3.0 FMU with structural parameters: x' = A x + B u, y = C x, with explicit Euler steps.

   m inputs, n states and r outputs. A change of sizes makes the arrays invalid, as the standard says: numbers that
   nobody sets again are NaN. The FMU accepts values of `deaf`, and ignores them. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))
#define MOST 6

enum { NEW, CONFIGURING, INITIALIZING, STEPPING };

typedef struct {
    int mode;
    size_t before[9]; /* numbers of elements by value reference, before the sizes change */
    fmi3UInt64 size[4]; /* by value reference: m, n, r */
    double A[MOST * MOST], B[MOST * MOST], C[MOST * MOST], x0[MOST], u[MOST], x[MOST], y[MOST];
} Model;

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String c[]) { return fmi3OK; }

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
                                         fmi3IntermediateUpdateCallback update)
{
    Model *m = strcmp(token, MODEL_GUID) ? NULL : calloc(1, sizeof *m);
    if (!m)
        return NULL;
    static const double A[] = {0, 1, -4, -1}, B[] = {0, 1}, C[] = {1, 0, 0, 1}, x0[] = {0.5, 0.5};
    m->size[1] = 1, m->size[2] = m->size[3] = 2;
    memcpy(m->A, A, sizeof A), memcpy(m->B, B, sizeof B), memcpy(m->C, C, sizeof C), memcpy(m->x0, x0, sizeof x0);
    m->u[0] = 1;
    return m;
}

EXPORT void fmi3FreeInstance(fmi3Instance i) { free(i); }

static fmi3Status move(Model *m, int from, int to)
{
    if (m->mode != from)
        return fmi3Error;
    m->mode = to;
    return fmi3OK;
}

static double *array(Model *m, fmi3ValueReference r, size_t *n)
{
    const fmi3UInt64 *s = m->size;
    *n = r == 4 ? s[2] * s[2] : r == 5 ? s[2] * s[1] : r == 6 ? s[3] * s[2] : r == 7 ? s[2] : r == 8 ? s[1] : s[3];
    return r == 4 ? m->A : r == 5 ? m->B : r == 6 ? m->C : r == 7 ? m->x0 : r == 8 ? m->u : r == 9 ? m->y : NULL;
}

EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance i)
{
    for (fmi3ValueReference r = 4; r < 9; r++)
        array(i, r, &((Model *)i)->before[r]);
    return move(i, NEW, CONFIGURING);
}

EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance i)
{
    Model *m = i;
    for (fmi3ValueReference r = 4; r < 9; r++) {
        size_t n;
        double *numbers = array(m, r, &n);
        for (size_t k = 0; k < n && n != m->before[r]; k++)
            numbers[k] = NAN;
    }
    return move(m, CONFIGURING, NEW);
}

static void compute(Model *m)
{
    for (size_t k = 0; k < m->size[3]; k++) {
        m->y[k] = 0;
        for (size_t j = 0; j < m->size[2]; j++)
            m->y[k] += m->C[k * m->size[2] + j] * m->x[j];
    }
}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean d, fmi3Float64 t, fmi3Float64 start,
                                       fmi3Boolean e, fmi3Float64 stop)
{
    Model *m = i;
    memcpy(m->x, m->x0, sizeof m->x);
    compute(m);
    return move(m, NEW, INITIALIZING);
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance i) { return move(i, INITIALIZING, STEPPING); }
EXPORT fmi3Status fmi3Terminate(fmi3Instance i) { return fmi3OK; }
EXPORT fmi3Status fmi3Reset(fmi3Instance i) { return fmi3Error; }

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t nr, fmi3Float64 v[], size_t nv)
{
    size_t at = 0, n;
    for (size_t k = 0; k < nr; k++, at += n) {
        const double *from = array(i, r[k], &n);
        if (!from || at + n > nv)
            return fmi3Error;
        memcpy(v + at, from, n * sizeof *v);
    }
    return at == nv ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t nr, const fmi3Float64 v[], size_t nv)
{
    size_t at = 0, n;
    for (size_t k = 0; k < nr; k++, at += n) {
        double *to = array(i, r[k], &n);
        if (!to || r[k] == 9 || at + n > nv || ((Model *)i)->mode == CONFIGURING)
            return fmi3Error;
        memcpy(to, v + at, n * sizeof *v);
    }
    return at == nv ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3GetUInt64(fmi3Instance i, const fmi3ValueReference r[], size_t nr, fmi3UInt64 v[], size_t nv)
{
    for (size_t k = 0; k < nr; k++)
        if (r[k] < 1 || r[k] > 3)
            return fmi3Error;
        else
            v[k] = ((Model *)i)->size[r[k]];
    return nr == nv ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3SetUInt64(fmi3Instance i, const fmi3ValueReference r[], size_t nr, const fmi3UInt64 v[], size_t nv)
{
    Model *m = i;
    for (size_t k = 0; k < nr; k++)
        if (m->mode != CONFIGURING || r[k] < 1 || r[k] > 3 || v[k] > MOST)
            return fmi3Error;
        else
            m->size[r[k]] = v[k];
    return nr == nv ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3GetBoolean(fmi3Instance i, const fmi3ValueReference r[], size_t nr, fmi3Boolean v[], size_t nv)
{
    v[0] = fmi3False;
    return nr == 1 && r[0] == 10 && nv == 1 ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3SetBoolean(fmi3Instance i, const fmi3ValueReference r[], size_t nr, const fmi3Boolean v[], size_t nv)
{
    return nr == 1 && r[0] == 10 && nv == 1 && ((Model *)i)->mode == CONFIGURING ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    Model *m = i;
    double rates[MOST] = {0};
    if (m->mode != STEPPING)
        return fmi3Error;
    for (size_t k = 0; k < m->size[2]; k++) {
        for (size_t j = 0; j < m->size[2]; j++)
            rates[k] += m->A[k * m->size[2] + j] * m->x[j];
        for (size_t j = 0; j < m->size[1]; j++)
            rates[k] += m->B[k * m->size[1] + j] * m->u[j];
    }
    for (size_t k = 0; k < m->size[2]; k++)
        m->x[k] += h * rates[k];
    compute(m);
    *event = *terminate = *early = fmi3False;
    *last = t + h;
    return fmi3OK;
}

#include "../fmi3_states.h"

ABSENT(fmi3ActivateModelPartition)
ABSENT(fmi3CompletedIntegratorStep)
ABSENT(fmi3EnterContinuousTimeMode)
ABSENT(fmi3EnterEventMode)
ABSENT(fmi3EnterStepMode)
ABSENT(fmi3EvaluateDiscreteStates)
ABSENT(fmi3GetAdjointDerivative)
ABSENT(fmi3GetBinary)
ABSENT(fmi3GetClock)
ABSENT(fmi3GetContinuousStateDerivatives)
ABSENT(fmi3GetContinuousStates)
ABSENT(fmi3GetDirectionalDerivative)
ABSENT(fmi3GetEventIndicators)
ABSENT(fmi3GetFloat32)
ABSENT(fmi3GetInt16)
ABSENT(fmi3GetInt32)
ABSENT(fmi3GetInt64)
ABSENT(fmi3GetInt8)
ABSENT(fmi3GetIntervalDecimal)
ABSENT(fmi3GetIntervalFraction)
ABSENT(fmi3GetNominalsOfContinuousStates)
ABSENT(fmi3GetNumberOfContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators)
ABSENT(fmi3GetNumberOfVariableDependencies)
ABSENT(fmi3GetOutputDerivatives)
ABSENT(fmi3GetShiftDecimal)
ABSENT(fmi3GetShiftFraction)
ABSENT(fmi3GetString)
ABSENT(fmi3GetUInt16)
ABSENT(fmi3GetUInt32)
ABSENT(fmi3GetUInt8)
ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3InstantiateModelExchange)
ABSENT(fmi3InstantiateScheduledExecution)
ABSENT(fmi3SetBinary)
ABSENT(fmi3SetClock)
ABSENT(fmi3SetContinuousStates)
ABSENT(fmi3SetFloat32)
ABSENT(fmi3SetInt16)
ABSENT(fmi3SetInt32)
ABSENT(fmi3SetInt64)
ABSENT(fmi3SetInt8)
ABSENT(fmi3SetIntervalDecimal)
ABSENT(fmi3SetIntervalFraction)
ABSENT(fmi3SetShiftDecimal)
ABSENT(fmi3SetShiftFraction)
ABSENT(fmi3SetString)
ABSENT(fmi3SetTime)
ABSENT(fmi3SetUInt16)
ABSENT(fmi3SetUInt32)
ABSENT(fmi3SetUInt8)
ABSENT(fmi3UpdateDiscreteStates)
