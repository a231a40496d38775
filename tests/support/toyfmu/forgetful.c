/* A co-simulation FMU of FMI 2.0 with x' = u, whose saved states do not have how many steps it did: each step adds
   another small number. */
#define FMI 2
#include "toyfmu.h"

enum { U, X, RATE };

struct Model {
    COMMON;
    double u, x, rate;
};

static const Variable variables[] = {
    VARIABLE(U, FLOAT64, u, INPUT), VARIABLE(X, FLOAT64, x, OUTPUT), VARIABLE(RATE, FLOAT64, rate, OUTPUT),
};

static int steps;

static void start(Model *m) { m->x = 1.0; }

static int step(Model *m, double time, double size, Step *s) {
    m->x += size * m->u + 1e-9 * ++steps;
    m->rate = m->u;
    m->time = s->last = time + size;
    return OK;
}

static const Toy toy = {MODEL(variables), .start = start, .step = step};
