/* An FMI 3.0 FMU with events, which refuses calls in a wrong mode, at a wrong time or in a wrong order.

   x' = u, and a state event at x = threshold subtracts the threshold. Time events every `period` increment `count`.
   Each event needs two updates of discrete states; the second latches the discrete input n, which can only be set in
   event mode. With CLOCK, the clock adds its input w to its output sum; both exist only while it ticks. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

#define SAME 1e-9

enum { INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, STEP = 8, TERMINATED = 16 };
enum { ENDLESS_UPDATES = 1, ENDLESS_RETURNS, UNASKED_EVENT, UNASKED_RETURN, NO_TIME, DISCARD };
enum { NONE, PERIODIC, ASKED, CHANGING, COUNTDOWN }; /* CLOCK */

typedef struct {
    int mode, events, early, updated, ticking, known;
    fmi3Float64 time, start, u, x, period, threshold, end, next, w, sum, previous, tick;
    fmi3Int32 n, bounces, count, latched, updates, fault, ticks;
} Model;

static int in(Model *m, int modes) { return (m->mode & modes) != 0; }

#define REQUIRE(modes) \
    do { if (!in(i, modes)) return fmi3Error; } while (0)

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String c[]) { return fmi3OK; }

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                                const fmi3ValueReference required[], size_t n,
                                                fmi3InstanceEnvironment environment, fmi3LogMessageCallback message,
                                                fmi3IntermediateUpdateCallback update)
{
    Model *m = strcmp(token, MODEL_GUID) ? NULL : calloc(1, sizeof *m);
    if (m) {
        m->mode = INSTANTIATED;
        m->events = events;
        m->early = early;
        m->u = 1.0;
        m->threshold = m->end = 1e9;
        m->next = m->tick = HUGE_VAL;
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
    if (CLOCK == PERIODIC)
        m->tick = start + 0.25;
    return fmi3OK;
}

static void handle_event(Model *m)
{
    m->count += m->next <= m->time + SAME;
    m->next = m->period > 0.0 ? m->start + (m->count + 1) * m->period : HUGE_VAL;
    if (m->x >= m->threshold - SAME) {
        m->x -= m->threshold;
        m->bounces++;
        if (CLOCK == COUNTDOWN)
            m->known = 2, m->tick = m->time + 0.05;
    }
    m->latched = m->n;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance i)
{
    Model *m = i;
    REQUIRE(INITIALIZATION);
    if ((CLOCK == ASKED || CLOCK == CHANGING) && m->tick == HUGE_VAL)
        return fmi3Error; /* its interval was not asked for */
    m->mode = m->events ? EVENT : STEP;
    m->updated = 0;
    if (!m->events)
        handle_event(m);
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance i)
{
    Model *m = i;
    REQUIRE(STEP);
    m->mode = m->events ? EVENT : TERMINATED;
    m->updated = 0;
    return m->events ? fmi3OK : fmi3Error;
}

/* Compute the clock's output; its input is only known while it ticks. */
static void compute(Model *m)
{
    if (m->ticking)
        m->sum = m->previous + m->w;
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean *more, fmi3Boolean *ends, fmi3Boolean *nominals,
                                           fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *next)
{
    Model *m = i;
    REQUIRE(EVENT);
    compute(m);
    if (m->ticking) {
        m->previous = m->sum;
        m->ticks++;
        m->tick = CLOCK == PERIODIC || CLOCK == ASKED ? m->start + 0.25 + m->ticks * 0.1 : HUGE_VAL;
        m->known = 0;
    }
    m->ticking = 0;
    m->updates++;
    *more = m->updated++ == 0 || m->fault == ENDLESS_UPDATES;
    if (m->updated == 2)
        handle_event(m);
    *ends = m->time >= m->end;
    *nominals = *states = fmi3False;
    *defined = m->next < HUGE_VAL || m->fault == NO_TIME;
    *next = m->fault == NO_TIME ? NAN : m->next;
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance i)
{
    Model *m = i;
    REQUIRE(EVENT);
    m->mode = STEP;
    const int told = CLOCK == NONE || CLOCK == PERIODIC || CLOCK == ASKED || (CLOCK == COUNTDOWN ? m->known != 2 : m->known);
    return m->updated >= 2 && told && m->tick > m->time + SAME && m->next > m->time + SAME ? fmi3OK : fmi3Error;
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
    fmi3Float64 end = t + h;
    if (h <= 0.0 || fabs(t - m->time) > SAME || (m->events && VARIES && end > m->next + SAME) || end > m->tick + SAME)
        return fmi3Error;
    if (m->fault == DISCARD && end > m->end)
        return fmi3Discard;
    *event = *terminate = *early = fmi3False;
    if (m->early && m->u > 0.0 && m->x + m->u * h > m->threshold + SAME) {
        end = t + (m->threshold - m->x) / m->u;
        *early = fmi3True;
    }
    m->x += m->u * (end - t);
    m->time = end;
    if (m->x >= m->threshold - SAME) {
        *event = m->events;
        if (!m->events)
            handle_event(m);
    }
    if (!m->events && m->next <= m->time + SAME)
        handle_event(m);
    if (m->fault == ENDLESS_RETURNS && m->early)
        *early = fmi3True, m->time = end = t;
    if (m->fault == UNASKED_EVENT)
        *event = fmi3True;
    if (m->fault == UNASKED_RETURN)
        *early = fmi3True;
    *last = end;
    return fmi3OK;
}

/* ---- variables --------------------------------------------------------------------------- */

static fmi3Float64 *number(Model *m, fmi3ValueReference r)
{
    fmi3Float64 *const all[] = {&m->time, &m->u, 0, &m->x, 0, 0, 0, 0, &m->period, &m->threshold, 0, &m->end};
    return r == 21 ? &m->w : r == 22 ? &m->sum : r < 12 ? all[r] : NULL;
}

static fmi3Int32 *integer(Model *m, fmi3ValueReference r)
{
    fmi3Int32 *const all[] = {0, 0, &m->n, 0, &m->bounces, &m->count, &m->latched, &m->updates, 0, 0, &m->fault};
    return r < 11 ? all[r] : NULL;
}

/* Whether a variable can be accessed now: clocked ones only while their clock ticks. */
static int is_open(Model *m, fmi3ValueReference r) { return r < 20 || m->ticking || in(m, INSTANTIATED | INITIALIZATION); }

static int is_settable(Model *m, fmi3ValueReference r)
{
    if (in(m, INSTANTIATED | INITIALIZATION))
        return r != 0;
    return is_open(m, r) && (r == 1 || r == 21 || (r == 2 && in(m, m->events ? EVENT : STEP)));
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

/* ---- the clock --------------------------------------------------------------------------- */

EXPORT fmi3Status fmi3SetClock(fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Clock v[])
{
    Model *m = i;
    REQUIRE(EVENT);
    if (CLOCK == NONE || n != 1 || r[0] != 20 || !v[0] || fabs(m->tick - m->time) > SAME)
        return fmi3Error;
    m->ticking = 1;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetIntervalDecimal(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 v[],
                                         fmi3IntervalQualifier q[])
{
    Model *m = i;
    REQUIRE(INITIALIZATION | EVENT);
    if (n != 1 || r[0] != 20)
        return fmi3Error;
    if (CLOCK == ASKED && in(m, INITIALIZATION))
        m->tick = m->start + 0.25;
    if (CLOCK == CHANGING && !m->known)
        m->tick = m->time + 0.1 * (m->ticks + 1), m->known = 2;
    v[0] = CLOCK == ASKED || CLOCK == PERIODIC ? 0.1 : CLOCK == CHANGING ? 0.1 * (m->ticks + 1) : 0.05;
    q[0] = (fmi3IntervalQualifier)(CLOCK == ASKED ? 2 : CLOCK == PERIODIC ? 1 : m->known);
    m->known -= m->known == 2;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetShiftDecimal(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 v[])
{
    REQUIRE(INITIALIZATION);
    v[0] = 0.25;
    return CLOCK == ASKED && n == 1 && r[0] == 20 ? fmi3OK : fmi3Error;
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
ABSENT(fmi3GetClock)
ABSENT(fmi3GetContinuousStateDerivatives)
ABSENT(fmi3GetContinuousStates)
ABSENT(fmi3GetDirectionalDerivative)
ABSENT(fmi3GetEventIndicators)
ABSENT(fmi3GetFloat32)
ABSENT(fmi3GetInt16)
ABSENT(fmi3GetInt64)
ABSENT(fmi3GetInt8)
ABSENT(fmi3GetIntervalFraction)
ABSENT(fmi3GetNominalsOfContinuousStates)
ABSENT(fmi3GetNumberOfContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators)
ABSENT(fmi3GetNumberOfVariableDependencies)
ABSENT(fmi3GetOutputDerivatives)
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
