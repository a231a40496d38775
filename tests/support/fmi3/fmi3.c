/* An FMI 3.0 FMU with all numeric types, arrays, states, and steps that end the run, are discarded or return early.

   References: 0 time, 1 u[2,2], 2 y[2,2] = gain * u, 3 gain[2,2], 4 x (integral of u[1,1]), 5 end, 6 fault,
   7 n (structural), 8 what a step adds to the Int64, 10 + 2 t the input of type t, 11 + 2 t the output: the same value,
   40 text, 42 and 43 the String as input and output; NULL if it is empty; 44 and 45 the Binary as input and output,
   46 a Binary of 0 to 3 bytes, or of 9 from the time `end` on, 47 a checksum of the input. */

#include <stdlib.h>
#include <string.h>

#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

enum { DISCARD = 1, TERMINATE = 2, EARLY = 3, EVENT = 4 };

typedef struct {
    fmi3Float64 time, u[4], gain[4], x, end;
    fmi3Int32 fault, checksum;
    fmi3Float32 float32;
    fmi3Int8 int8;
    fmi3UInt8 uint8;
    fmi3Int16 int16;
    fmi3UInt16 uint16;
    fmi3Int32 int32;
    fmi3UInt32 uint32;
    fmi3Int64 int64, choice, stride;
    fmi3UInt64 uint64;
    fmi3Boolean boolean;
    char text[64], passed[64];
    fmi3Byte bytes[8];
    size_t size;
} Model;

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String c[]) { return fmi3OK; }

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
                                         fmi3IntermediateUpdateCallback update)
{
    Model *m = strcmp(token, MODEL_GUID) || events || early ? NULL : calloc(1, sizeof *m);
    if (m)
        m->choice = 1;
    for (int k = 0; m && k < 4; k++) {
        m->gain[k] = k + 1.0;
        m->u[k] = 0.5;
    }
    return m;
}

EXPORT void fmi3FreeInstance(fmi3Instance i) { free(i); }

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean d, fmi3Float64 t, fmi3Float64 start,
                                       fmi3Boolean e, fmi3Float64 stop)
{
    ((Model *)i)->time = start;
    return fmi3OK;
}

#define FINE(name) EXPORT fmi3Status name(fmi3Instance i) { return fmi3OK; }
FINE(fmi3ExitInitializationMode)
FINE(fmi3Terminate)
FINE(fmi3Reset)

static fmi3Float64 *numbers(Model *m, fmi3ValueReference r, size_t *n)
{
    *n = r == 1 || r == 3 ? 4 : 1;
    return r == 0 ? &m->time : r == 1 ? m->u : r == 3 ? m->gain : r == 4 ? &m->x : r == 5 ? &m->end : NULL;
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t nr, fmi3Float64 v[], size_t nv)
{
    Model *m = i;
    size_t at = 0, n;
    for (size_t k = 0; k < nr; k++) {
        const fmi3Float64 *from = numbers(m, r[k], &n);
        if (r[k] == 2) {
            for (n = 0; n < 4 && at + n < nv; n++)
                v[at + n] = m->gain[n] * m->u[n];
        } else {
            if (!from || at + n > nv)
                return fmi3Error;
            memcpy(v + at, from, n * sizeof *v);
        }
        at += n;
    }
    return at == nv ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t nr, const fmi3Float64 v[], size_t nv)
{
    size_t at = 0, n;
    for (size_t k = 0; k < nr; k++, at += n) {
        fmi3Float64 *to = numbers(i, r[k], &n);
        if (!to || at + n > nv)
            return fmi3Error;
        memcpy(to, v + at, n * sizeof *v);
    }
    return at == nv ? fmi3OK : fmi3Error;
}

/* Variables with the references `first` (input) and `first` + 1 (output); Int32 has the parameter `fault`, too. */
#define TYPE(Name, field, first)                                                                                  \
    static fmi3##Name *field##_of(Model *m, fmi3ValueReference r) { return r / 2 == first / 2 ? &m->field : NULL; } \
    ACCESS(Name, field)
#define ACCESS(Name, field)                                                                                       \
    EXPORT fmi3Status fmi3Get##Name(fmi3Instance i, const fmi3ValueReference r[], size_t nr, fmi3##Name v[], size_t nv) \
    {                                                                                                             \
        for (size_t k = 0; k < nr; k++)                                                                           \
            if (!FIELD(field, i, r[k]))                                                                           \
                return fmi3Error;                                                                                 \
            else                                                                                                  \
                v[k] = *FIELD(field, i, r[k]);                                                                    \
        return nr == nv ? fmi3OK : fmi3Error;                                                                     \
    }                                                                                                             \
    EXPORT fmi3Status fmi3Set##Name(fmi3Instance i, const fmi3ValueReference r[], size_t nr, const fmi3##Name v[],       \
                             size_t nv)                                                                           \
    {                                                                                                             \
        for (size_t k = 0; k < nr; k++)                                                                           \
            if (!FIELD(field, i, r[k]))                                                                           \
                return fmi3Error;                                                                                 \
            else                                                                                                  \
                *FIELD(field, i, r[k]) = v[k];                                                                    \
        return nr == nv ? fmi3OK : fmi3Error;                                                                     \
    }
#define FIELD(field, i, r) field##_of(i, r)

TYPE(Float32, float32, 10)
TYPE(Int8, int8, 12)
TYPE(UInt8, uint8, 14)
TYPE(Int16, int16, 16)
TYPE(UInt16, uint16, 18)
TYPE(UInt32, uint32, 22)
TYPE(UInt64, uint64, 26)
TYPE(Boolean, boolean, 28)

static fmi3Int32 *int32_of(Model *m, fmi3ValueReference r) { return r == 6 ? &m->fault : r == 47 ? &m->checksum : r / 2 == 10 ? &m->int32 : NULL; }
ACCESS(Int32, int32)
static fmi3Int64 *int64_of(Model *m, fmi3ValueReference r) { return r / 2 == 12 ? &m->int64 : r / 2 == 15 ? &m->choice : r == 8 ? &m->stride : NULL; }
ACCESS(Int64, int64)

EXPORT fmi3Status fmi3GetString(fmi3Instance i, const fmi3ValueReference r[], size_t nr, fmi3String v[], size_t nv)
{
    for (size_t k = 0; k < nv; k++)
        v[k] = r[k] == 40 ? ((Model *)i)->text : ((Model *)i)->passed[0] ? ((Model *)i)->passed : NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetString(fmi3Instance i, const fmi3ValueReference r[], size_t nr, const fmi3String v[], size_t nv)
{
    strncpy(r[0] == 40 ? ((Model *)i)->text : ((Model *)i)->passed, v[0], 63);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetBinary(fmi3Instance i, const fmi3ValueReference r[], size_t nr, size_t sizes[], fmi3Binary v[],
                         size_t nv)
{
    static fmi3Byte source[9]; /* which the next call changes */
    Model *m = i;
    int count = (int)(8.0 * m->time + 0.5);
    for (size_t k = 0; k < 9; k++)
        source[k] = (fmi3Byte)(k == 1 ? 0 : 250 + count);
    for (size_t k = 0; k < nv; k++) {
        sizes[k] = r[k] != 46 ? m->size : m->end > 0.0 && m->time >= m->end ? 9 : (size_t)count % 4;
        v[k] = r[k] != 46 ? m->bytes : sizes[k] ? source : NULL;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetBinary(fmi3Instance i, const fmi3ValueReference r[], size_t nr, const size_t sizes[],
                         const fmi3Binary v[], size_t nv)
{
    Model *m = i;
    if (r[0] != 44 || sizes[0] > sizeof m->bytes)
        return fmi3Error;
    m->size = sizes[0];
    memcpy(m->bytes, v[0], sizes[0]);
    m->checksum = 1000 * (fmi3Int32)m->size;
    for (size_t k = 0; k < m->size; k++)
        m->checksum += (fmi3Int32)(k + 1) * m->bytes[k];
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    Model *m = i;
    int faulty = m->fault && t + h > m->end;
    if (faulty && m->fault == DISCARD)
        return fmi3Discard;
    *event = faulty && m->fault == EVENT;
    *terminate = faulty && m->fault == TERMINATE;
    *early = faulty && m->fault == EARLY;
    *last = *early ? t : t + h;
    m->x += (*last - t) * m->u[0];
    m->time = *last;
    m->int64 += m->stride;
    return fmi3OK;
}

#include "../fmi3_states.h"

ABSENT(fmi3ActivateModelPartition)
ABSENT(fmi3CompletedIntegratorStep)
ABSENT(fmi3EnterConfigurationMode)
ABSENT(fmi3EnterContinuousTimeMode)
ABSENT(fmi3EnterEventMode)
ABSENT(fmi3EnterStepMode)
ABSENT(fmi3EvaluateDiscreteStates)
ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3GetAdjointDerivative)
ABSENT(fmi3GetClock)
ABSENT(fmi3GetContinuousStateDerivatives)
ABSENT(fmi3GetContinuousStates)
ABSENT(fmi3GetDirectionalDerivative)
ABSENT(fmi3GetEventIndicators)
ABSENT(fmi3GetIntervalDecimal)
ABSENT(fmi3GetIntervalFraction)
ABSENT(fmi3GetNominalsOfContinuousStates)
ABSENT(fmi3GetNumberOfContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators)
ABSENT(fmi3GetNumberOfVariableDependencies)
ABSENT(fmi3GetOutputDerivatives)
ABSENT(fmi3GetShiftDecimal)
ABSENT(fmi3GetShiftFraction)
ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3InstantiateModelExchange)
ABSENT(fmi3InstantiateScheduledExecution)
ABSENT(fmi3SetClock)
ABSENT(fmi3SetContinuousStates)
ABSENT(fmi3SetIntervalDecimal)
ABSENT(fmi3SetIntervalFraction)
ABSENT(fmi3SetShiftDecimal)
ABSENT(fmi3SetShiftFraction)
ABSENT(fmi3SetTime)
ABSENT(fmi3UpdateDiscreteStates)
