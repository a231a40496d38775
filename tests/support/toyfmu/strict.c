/* A co-simulation FMU of FMI 2.0 or 3.0 with x' = u that refuses steps past the time `last`, by any amount. Its
   output `reached` is the end of its last step. */
#include "toyfmu.h"

enum { U, LAST, X, REACHED, COUNT };

struct Model {
    COMMON;
    double value[COUNT];
};

#define VALUE(name, settable) VARIABLE(name, FLOAT64, value[name], settable)
static const Variable variables[] = {
    VALUE(U, INPUT), VALUE(LAST, PARAMETER), VALUE(X, PARAMETER), VALUE(REACHED, OUTPUT),
    VARIABLE(COUNT, FLOAT64, time, OUTPUT),
};

static void start(Model *m) {
    m->value[LAST] = HUGE_VAL;
    m->value[X] = 1.0;
}

static int step(Model *m, double time, double size, Step *s) {
    const double end = time + size;
    if (end > m->value[LAST]) return say(m, ERROR, "the step to t = %.17g s is past %.17g s.", end, m->value[LAST]);
    m->value[X] += size * m->value[U];
    m->value[REACHED] = m->time = s->last = end;
    return OK;
}

static const Toy toy = {MODEL(variables), .start = start, .step = step};
