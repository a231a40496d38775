/* An FMI 3.0 FMU with events, which refuses calls in a wrong mode, at a wrong time or in a wrong order.

   x' = u, and a state event at x = threshold subtracts the threshold. Time events every `period` increment `count`.
   Each event needs two updates of discrete states; the second latches the discrete input n, which can only be set in
   event mode. With CLOCK, the clock adds its input w to its output sum; both exist only while it ticks. */
#define FMI 3
#include "toyfmu.h"

#define SAME 1e-9

enum { ENDLESS_UPDATES = 1, ENDLESS_RETURNS, UNEXPECTED_EVENT, UNEXPECTED_RETURN, NO_TIME, DISCARD }; /* fault */
enum { NONE, PERIODIC, FIXED, CHANGING, COUNTDOWN };                                                  /* CLOCK */

struct Model {
    COMMON;
    int updated, ticking, known;
    double u, x, period, threshold, end, next, w, sum, previous, tick;
    int32_t n, bounces, count, latched, updates, fault, ticks;
};

static const Variable variables[] = {
    VARIABLE(0, FLOAT64, time, OUTPUT),         VARIABLE(1, FLOAT64, u, INPUT),
    VARIABLE(2, INT32, n, INPUT),               VARIABLE(3, FLOAT64, x, PARAMETER),
    VARIABLE(4, INT32, bounces, PARAMETER),     VARIABLE(5, INT32, count, PARAMETER),
    VARIABLE(6, INT32, latched, PARAMETER),     VARIABLE(7, INT32, updates, PARAMETER),
    VARIABLE(8, FLOAT64, period, PARAMETER),    VARIABLE(9, FLOAT64, threshold, PARAMETER),
    VARIABLE(10, INT32, fault, PARAMETER),      VARIABLE(11, FLOAT64, end, PARAMETER),
    VARIABLE(21, FLOAT64, w, INPUT),            VARIABLE(22, FLOAT64, sum, PARAMETER),
};

static void start(Model *m) {
    m->u = 1.0;
    m->threshold = m->end = 1e9;
    m->next = m->tick = HUGE_VAL;
}

static int set_up(Model *m, int has_tolerance, double tolerance) {
    if (CLOCK == PERIODIC) m->tick = m->begin + 0.25;
    return OK;
}

static void handle_event(Model *m) {
    m->count += m->next <= m->time + SAME;
    m->next = m->period > 0.0 ? m->begin + (m->count + 1) * m->period : HUGE_VAL;
    if (m->x >= m->threshold - SAME) {
        m->x -= m->threshold;
        m->bounces++;
        if (CLOCK == COUNTDOWN) m->known = 2, m->tick = m->time + 0.05;
    }
    m->latched = m->n;
}

static int exit_initialization(Model *m) {
    if ((CLOCK == FIXED || CLOCK == CHANGING) && m->tick == HUGE_VAL) return ERROR; /* its interval was not read */
    m->updated = 0;
    if (!m->events) handle_event(m);
    return OK;
}

static int enter_events(Model *m) {
    m->updated = 0;
    return OK;
}

/* The clock's output; its input is only known while it ticks. */
static void compute(Model *m) {
    if (m->ticking) m->sum = m->previous + m->w;
}

static int update(Model *m, Update *u) {
    compute(m);
    if (m->ticking) {
        m->previous = m->sum;
        m->ticks++;
        m->tick = CLOCK == PERIODIC || CLOCK == FIXED ? m->begin + 0.25 + m->ticks * 0.1 : HUGE_VAL;
        m->known = 0;
    }
    m->ticking = 0;
    m->updates++;
    u->again = m->updated++ == 0 || m->fault == ENDLESS_UPDATES;
    if (m->updated == 2) handle_event(m);
    u->terminate = m->time >= m->end;
    u->has_next = m->next < HUGE_VAL || m->fault == NO_TIME;
    u->next = m->fault == NO_TIME ? NAN : m->next;
    return OK;
}

static int leave_events(Model *m) {
    const int was_read = CLOCK == COUNTDOWN ? m->known != 2 : CLOCK == CHANGING ? m->known : 1;
    return m->updated >= 2 && was_read && m->tick > m->time + SAME && m->next > m->time + SAME ? OK : ERROR;
}

static int step(Model *m, double t, double h, Step *s) {
    double end = t + h;
    if (h <= 0.0 || fabs(t - m->time) > SAME || (m->events && VARIES && end > m->next + SAME) || end > m->tick + SAME)
        return ERROR;
    if (m->fault == DISCARD && end > m->end) return DISCARDED;
    if (m->early && m->u > 0.0 && m->x + m->u * h > m->threshold + SAME) {
        end = t + (m->threshold - m->x) / m->u;
        s->early = 1;
    }
    m->x += m->u * (end - t);
    m->time = end;
    if (m->x >= m->threshold - SAME) {
        s->event = m->events;
        if (!m->events) handle_event(m);
    }
    if (!m->events && m->next <= m->time + SAME) handle_event(m);
    if (m->fault == ENDLESS_RETURNS && m->early) s->early = 1, m->time = end = t;
    if (m->fault == UNEXPECTED_EVENT) s->event = 1;
    if (m->fault == UNEXPECTED_RETURN) s->early = 1;
    s->last = end;
    return OK;
}

/* Clocked variables exist while their clock ticks; n is set in event mode if there is one. */
static int forbids(Model *m, unsigned r, const void *set) {
    if (m->mode & PARAMETER) return 0;
    return (r > 20 && !m->ticking) || (set && r == 2 && m->mode != (m->events ? EVENT : STEP));
}

static int set_clock(Model *m, unsigned r, int active) {
    if (CLOCK == NONE || r != 20 || !active || fabs(m->tick - m->time) > SAME) return ERROR;
    m->ticking = 1;
    return OK;
}

static int interval(Model *m, unsigned r, double *value, int *qualifier) {
    if (r != 20) return ERROR;
    if (CLOCK == FIXED && m->mode == INITIALIZATION) m->tick = m->begin + 0.25;
    if (CLOCK == CHANGING && !m->known) m->tick = m->time + 0.1 * (m->ticks + 1), m->known = 2;
    *value = CLOCK == FIXED || CLOCK == PERIODIC ? 0.1 : CLOCK == CHANGING ? 0.1 * (m->ticks + 1) : 0.05;
    *qualifier = CLOCK == FIXED ? 2 : CLOCK == PERIODIC ? 1 : m->known;
    m->known -= m->known == 2;
    return OK;
}

static int shift(Model *m, unsigned r, double *value) {
    *value = 0.25;
    return CLOCK == FIXED && r == 20 ? OK : ERROR;
}

static const Toy toy = {
    MODEL(variables), .start = start, .set_up = set_up, .exit_initialization = exit_initialization,
    .enter_events = enter_events, .compute = compute, .update = update, .leave_events = leave_events, .step = step,
    .forbids = forbids, .set_clock = set_clock, .interval = interval, .shift = shift,
};
