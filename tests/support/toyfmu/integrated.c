/* A Model Exchange FMU of FMI 2.0 or 3.0: x' = u - x, a bouncing ball (state events), a stair of 0.1 s (time events),
   and a reset of x by step events; y = x + gain u. It refuses calls in modes where the standard does not allow them.
   INDICATORS is the number of event indicators that it says it has. */
#include "toyfmu.h"

enum { X, H, V, DX, DH, DV, U, STAIR, RESETS, LIMIT, END, FAILS, GAIN, Y, COUNT, TIME = 20 };

struct Model {
    COMMON;
    double value[COUNT], next;
};

#define VALUE(name, settable) VARIABLE(name, FLOAT64, value[name], settable)
static const Variable variables[] = {
    VALUE(X, PARAMETER), VALUE(H, PARAMETER), VALUE(V, PARAMETER), VALUE(DX, OUTPUT), VALUE(DH, OUTPUT),
    VALUE(DV, OUTPUT), VALUE(U, INPUT), VALUE(STAIR, PARAMETER), VALUE(RESETS, PARAMETER), VALUE(LIMIT, PARAMETER),
    VALUE(END, PARAMETER), VALUE(FAILS, PARAMETER), VALUE(GAIN, PARAMETER), VALUE(Y, OUTPUT),
    VARIABLE(TIME, FLOAT64, time, OUTPUT),
};

static void start(Model *m) {
    static const double first[COUNT] = {[X] = 1, [H] = 1, [LIMIT] = 1e9, [END] = 1e9, [FAILS] = 1e9};
    memcpy(m->value, first, sizeof first);
}

static int exit_initialization(Model *m) {
    m->next = m->time + 0.1;
    return OK;
}

static void compute(Model *m) {
    double *s = m->value;
    s[DX] = m->time >= s[FAILS] ? NAN : s[U] - s[X];
    s[DH] = s[V];
    s[DV] = -9.81;
    s[Y] = s[X] + s[GAIN] * s[U];
}

static int update(Model *m, Update *u) {
    double *s = m->value;
    int changed = 0;
    if (s[H] <= 0 && s[V] < 0) s[H] = 0, s[V] *= -0.7, changed = 1;
    if (m->time >= m->next) s[STAIR] += 1, m->next = m->next + 0.1, changed = 1;
    if (s[X] > s[LIMIT]) s[X] = 0, s[RESETS] += 1, changed = 1;
    u->again = u->values_changed = changed;
    u->terminate = s[END] >= 0 && s[STAIR] >= s[END];
    u->has_next = 1;
    u->next = s[END] < 0 ? NAN : m->next; /* a fault */
    return OK;
}

static int completed(Model *m, int *enters_event_mode) {
    *enters_event_mode = m->value[X] > m->value[LIMIT];
    return OK;
}

static void derivatives(Model *m, double dx[]) {
    compute(m);
    memcpy(dx, m->value + DX, 3 * sizeof *dx);
}

static void get_indicators(Model *m, double z[]) { z[0] = m->value[H]; }

static const Toy toy = {
    MODEL(variables), .exchange = 1, .states = 3, .indicators = INDICATORS, .state_offset = offsetof(Model, value),
    .start = start, .exit_initialization = exit_initialization, .compute = compute, .update = update,
    .completed = completed, .derivatives = derivatives, .get_indicators = get_indicators,
};
