/* An FMI 3.0 FMU with triggered clocks, which refuses calls in a wrong mode and of variables whose clock does not tick.

   x is the time since the start. The output clock `alarm` ticks every `period`, `burst` times at once, each time at an
   instant of its own, and with `rings` at the start; `level` is the number of its ticks. The triggered input clock `go`
   adds w to sum and is counted; the output clock `echo` ticks with it. With SUB, the periodic clock `beat` ticks every
   0.1 s, and `sub`, which depends on it, every SUB s. */
#define FMI 3
#include "toyfmu.h"

#define SAME 1e-9

enum { CLEAR_IN_UPDATE, CLEAR_IN_GET, NEVER_CLEAR }; /* manner: when the output clock becomes inactive */

struct Model {
    COMMON;
    int alarm, go, beat, sub, updated;
    double x, period, level, w, sum, previous, last;
    int32_t burst, manner, rings, left, time_events, alarms, ticks, beats, subs;
};

static const Variable variables[] = {
    VARIABLE(0, FLOAT64, time, OUTPUT),      VARIABLE(1, FLOAT64, period, PARAMETER),
    VARIABLE(2, INT32, burst, PARAMETER),    VARIABLE(3, INT32, manner, PARAMETER),
    VARIABLE(4, FLOAT64, x, PARAMETER),      VARIABLE(5, INT32, rings, PARAMETER),
    VARIABLE(11, FLOAT64, level, PARAMETER), VARIABLE(21, FLOAT64, w, INPUT),
    VARIABLE(22, FLOAT64, sum, PARAMETER),   VARIABLE(23, INT32, ticks, PARAMETER),
    VARIABLE(24, FLOAT64, last, PARAMETER),  VARIABLE(33, INT32, beats, PARAMETER),
    VARIABLE(34, INT32, subs, PARAMETER),
};

static int accepts(const Common *instance) { return instance->events; }

static void start(Model *m) { m->burst = 1; }

static int enter_initialization(Model *m) {
    m->last = -1.0;
    return OK;
}

static double next_alarm(const Model *m) {
    return m->period > 0.0 ? m->begin + (m->time_events + 1) * m->period : HUGE_VAL;
}

static double next_beat(const Model *m) { return SUB > 0 ? m->begin + m->beats * 0.1 : HUGE_VAL; }

static void ring(Model *m) {
    m->alarm = 1;
    m->level = ++m->alarms;
}

static int exit_initialization(Model *m) {
    if (m->rings) ring(m);
    return OK;
}

static int enter_events(Model *m) {
    m->updated = 0;
    if (next_alarm(m) <= m->time + SAME) {
        m->time_events++;
        m->left = m->burst;
        if (m->manner == CLEAR_IN_UPDATE) ring(m);
    }
    return OK;
}

static void compute(Model *m) {
    if (m->go) m->sum = m->previous + m->w;
}

static int update(Model *m, Update *u) {
    if (m->sub && !m->beat) return ERROR;
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
    if (m->left > 0) { /* other manners set the clock here */
        ring(m);
        m->left -= m->manner != CLEAR_IN_UPDATE;
        u->again = m->manner == CLEAR_IN_UPDATE;
    }
    m->updated = 1;
    u->next = next_alarm(m);
    u->has_next = u->next < HUGE_VAL;
    return OK;
}

static int leave_events(Model *m) { return m->updated && next_beat(m) > m->time + SAME ? OK : ERROR; }

static int step(Model *m, double t, double h, Step *s) {
    if (h <= 0.0 || fabs(t - m->time) > SAME || t + h > next_alarm(m) + SAME || t + h > next_beat(m) + SAME)
        return ERROR;
    m->time = t + h;
    m->x = m->time - m->begin;
    return OK;
}

static int forbids(Model *m, unsigned r, const void *set) {
    if (m->mode & PARAMETER) return 0;
    return r == 11 ? m->manner == CLEAR_IN_UPDATE && !m->alarm : (r == 21 || r == 22) && !m->go;
}

static int set_clock(Model *m, unsigned r, int active) {
    if (r == 20) m->go = active;
    else if (r == 31 && fabs(next_beat(m) - m->time) < SAME) m->beat = active;
    else if (r == 32 && m->beat) m->sub = active; /* only after the clock on which it depends */
    else return ERROR;
    return OK;
}

static int get_clock(Model *m, unsigned r, Boolean *active) {
    if (r != 10 && r != 13) return ERROR;
    *active = r == 10 ? m->alarm : m->go;
    if (r == 10 && m->manner == CLEAR_IN_GET) m->alarm = 0;
    return OK;
}

static const Toy toy = {
    MODEL(variables), .accepts = accepts, .start = start, .enter_initialization = enter_initialization,
    .exit_initialization = exit_initialization, .enter_events = enter_events, .compute = compute, .update = update,
    .leave_events = leave_events, .step = step, .forbids = forbids, .set_clock = set_clock, .get_clock = get_clock,
};
