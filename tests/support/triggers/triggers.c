/* An FMI 3.0 FMU with triggered clocks, which refuses calls in a wrong mode and of variables whose clock does not tick.

   x is the time since the start. The output clock `alarm` ticks every `period`, `burst` times at once, each time at an
   instant of its own, and with `rings` at the start; `level` is the number of its ticks. The triggered input clock `go` adds w to sum and is counted;
   the output clock `echo` ticks with it. With SUB, the periodic clock `beat` ticks every 0.1 s, and `sub`, which depends
   on it, every SUB s. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

#define SAME 1e-9

enum { INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, STEP = 8, TERMINATED = 16 };
enum { CLEAR_IN_UPDATE, CLEAR_IN_GET, NEVER_CLEAR }; /* manner: when the output clock becomes inactive */

typedef struct {
    int mode, alarm, go, beat, sub, updated;
    fmi3Float64 time, start, x, period, level, w, sum, previous, last;
    fmi3Int32 burst, manner, rings, left, events, alarms, ticks, beats, subs;
} Model;

#define REQUIRE(modes) \
    do { if (!(((Model *)i)->mode & (modes))) return fmi3Error; } while (0)

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String c[]) { return fmi3OK; }

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                                const fmi3ValueReference required[], size_t n,
                                                fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
                                                fmi3IntermediateUpdateCallback update)
{
    Model *m = strcmp(token, MODEL_GUID) || !events ? NULL : calloc(1, sizeof *m);
    if (m) {
        m->mode = INSTANTIATED;
        m->burst = 1;
    }
    return m;
}

EXPORT void fmi3FreeInstance(fmi3Instance i) { free(i); }

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean d, fmi3Float64 t, fmi3Float64 start,
                                              fmi3Boolean e, fmi3Float64 stop)
{
    Model *m = i;
    REQUIRE(INSTANTIATED);
    m->mode = INITIALIZATION;
    m->time = m->start = start;
    m->last = -1.0;
    return fmi3OK;
}

static fmi3Float64 next(const Model *m)
{
    return m->period > 0.0 ? m->start + (m->events + 1) * m->period : HUGE_VAL;
}

static fmi3Float64 beat(const Model *m) { return SUB > 0 ? m->start + m->beats * 0.1 : HUGE_VAL; }

static void ring(Model *m)
{
    m->alarm = 1;
    m->alarms++;
    m->level = m->alarms;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance i)
{
    Model *m = i;
    REQUIRE(INITIALIZATION);
    m->mode = EVENT;
    if (m->rings)
        ring(m);
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance i)
{
    Model *m = i;
    REQUIRE(STEP);
    m->mode = EVENT;
    m->updated = 0;
    if (next(m) <= m->time + SAME) {
        m->events++;
        m->left = m->burst;
        if (m->manner == CLEAR_IN_UPDATE)
            ring(m);
    }
    return fmi3OK;
}

static void compute(Model *m)
{
    if (m->go)
        m->sum = m->previous + m->w;
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean *more, fmi3Boolean *ends, fmi3Boolean *nominals,
                                           fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *event)
{
    Model *m = i;
    REQUIRE(EVENT);
    if (m->sub && !m->beat)
        return fmi3Error;
    compute(m);
    if (m->go) {
        m->previous = m->sum;
        m->ticks++;
        m->last = m->time;
    }
    m->beats += m->beat;
    m->subs += m->sub;
    m->go = m->beat = m->sub = 0;
    if (m->manner == CLEAR_IN_UPDATE) {
        m->alarm = 0;
        m->left -= m->left > 0;
    }
    *more = fmi3False;
    if (m->left > 0) { /* the others set the clock here */
        ring(m);
        m->left -= m->manner != CLEAR_IN_UPDATE;
        *more = m->manner == CLEAR_IN_UPDATE;
    }
    m->updated = 1;
    *ends = *nominals = *states = fmi3False;
    *defined = next(m) < HUGE_VAL;
    *event = next(m);
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance i)
{
    Model *m = i;
    REQUIRE(EVENT);
    m->mode = STEP;
    return m->updated && beat(m) > m->time + SAME ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance i)
{
    REQUIRE(EVENT | STEP);
    ((Model *)i)->mode = TERMINATED;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance i) { return fmi3Error; }

EXPORT fmi3Status fmi3DoStep(fmi3Instance i, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no, fmi3Boolean *event,
                             fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    Model *m = i;
    REQUIRE(STEP);
    if (h <= 0.0 || fabs(t - m->time) > SAME || t + h > next(m) + SAME || t + h > beat(m) + SAME)
        return fmi3Error;
    m->time = *last = t + h;
    m->x = m->time - m->start;
    *event = *terminate = *early = fmi3False;
    return fmi3OK;
}

/* ---- variables --------------------------------------------------------------------------- */

static fmi3Float64 *number(Model *m, fmi3ValueReference r)
{
    switch (r) {
    case 0: return &m->time;
    case 1: return &m->period;
    case 4: return &m->x;
    case 11: return &m->level;
    case 21: return &m->w;
    case 22: return &m->sum;
    case 24: return &m->last;
    }
    return NULL;
}

static fmi3Int32 *integer(Model *m, fmi3ValueReference r)
{
    switch (r) {
    case 2: return &m->burst;
    case 3: return &m->manner;
    case 5: return &m->rings;
    case 23: return &m->ticks;
    case 33: return &m->beats;
    case 34: return &m->subs;
    }
    return NULL;
}

static int is_open(Model *m, fmi3ValueReference r)
{
    if (m->mode & (INSTANTIATED | INITIALIZATION))
        return 1;
    return r == 11 ? m->manner != CLEAR_IN_UPDATE || m->alarm : r != 21 && r != 22 ? 1 : m->go;
}

static int is_settable(Model *m, fmi3ValueReference r)
{
    return m->mode & (INSTANTIATED | INITIALIZATION) ? r != 0 : r == 21 && m->go;
}

#define ACCESS(Name, find)                                                                                        \
    EXPORT fmi3Status fmi3Get##Name(fmi3Instance i, const fmi3ValueReference r[], size_t nr, fmi3##Name v[], size_t nv) \
    {                                                                                                             \
        compute(i);                                                                                               \
        for (size_t k = 0; k < nr; k++) {                                                                         \
            if (!find(i, r[k]) || !is_open(i, r[k]))                                                              \
                return fmi3Error;                                                                                 \
            v[k] = *find(i, r[k]);                                                                                \
        }                                                                                                         \
        return nr == nv ? fmi3OK : fmi3Error;                                                                     \
    }                                                                                                             \
    EXPORT fmi3Status fmi3Set##Name(fmi3Instance i, const fmi3ValueReference r[], size_t nr, const fmi3##Name v[], \
                                    size_t nv)                                                                    \
    {                                                                                                             \
        for (size_t k = 0; k < nr; k++) {                                                                         \
            if (!find(i, r[k]) || !is_settable(i, r[k]))                                                          \
                return fmi3Error;                                                                                 \
            *find(i, r[k]) = v[k];                                                                                \
        }                                                                                                         \
        return nr == nv ? fmi3OK : fmi3Error;                                                                     \
    }
ACCESS(Float64, number)
ACCESS(Int32, integer)

/* ---- clocks ------------------------------------------------------------------------------ */

EXPORT fmi3Status fmi3SetClock(fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Clock v[])
{
    Model *m = i;
    REQUIRE(EVENT);
    for (size_t k = 0; k < n; k++) {
        if (r[k] == 20)
            m->go = v[k];
        else if (r[k] == 31 && fabs(beat(m) - m->time) < SAME)
            m->beat = v[k];
        else if (r[k] == 32 && m->beat) /* only after the clock on which it depends */
            m->sub = v[k];
        else
            return fmi3Error;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetClock(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Clock v[])
{
    Model *m = i;
    REQUIRE(EVENT);
    for (size_t k = 0; k < n; k++) {
        if (r[k] != 10 && r[k] != 13)
            return fmi3Error;
        v[k] = r[k] == 10 ? m->alarm : m->go;
        if (r[k] == 10 && m->manner == CLEAR_IN_GET)
            m->alarm = 0;
    }
    return fmi3OK;
}

/* ---- states, and what is missing ---------------------------------------------------------- */

#include "../fmi3_states.h"

ABSENT(fmi3ActivateModelPartition)
ABSENT(fmi3CompletedIntegratorStep)
ABSENT(fmi3EnterConfigurationMode)
ABSENT(fmi3EnterContinuousTimeMode)
ABSENT(fmi3EvaluateDiscreteStates)
ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3GetAdjointDerivative)
ABSENT(fmi3GetBinary)
ABSENT(fmi3GetBoolean)
ABSENT(fmi3GetContinuousStateDerivatives)
ABSENT(fmi3GetContinuousStates)
ABSENT(fmi3GetDirectionalDerivative)
ABSENT(fmi3GetEventIndicators)
ABSENT(fmi3GetFloat32)
ABSENT(fmi3GetInt16)
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
ABSENT(fmi3GetUInt64)
ABSENT(fmi3GetUInt8)
ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3InstantiateModelExchange)
ABSENT(fmi3InstantiateScheduledExecution)
ABSENT(fmi3SetBinary)
ABSENT(fmi3SetBoolean)
ABSENT(fmi3SetContinuousStates)
ABSENT(fmi3SetFloat32)
ABSENT(fmi3SetInt16)
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
ABSENT(fmi3SetUInt64)
ABSENT(fmi3SetUInt8)
