/* An FMI 3.0 FMU with structural parameters: x' = A x + B u, y = C x, with explicit Euler steps.

   m inputs, n states and r outputs. A change of sizes makes the arrays invalid, as the standard says: numbers that
   are not set again are NaN. The FMU accepts values of `deaf`, and ignores them. */
#define FMI 3
#include "toyfmu.h"

#define MOST 6

struct Model {
    COMMON;
    size_t before[6]; /* numbers of elements of variables before the sizes change */
    uint64_t m, n, r;
    double A[MOST * MOST], B[MOST * MOST], C[MOST * MOST], x0[MOST], u[MOST], x[MOST], y[MOST];
    bool deaf;
};

static const Variable variables[] = {
    VARIABLE(4, FLOAT64, A, INPUT),     VARIABLE(5, FLOAT64, B, INPUT),     VARIABLE(6, FLOAT64, C, INPUT),
    VARIABLE(7, FLOAT64, x0, INPUT),    VARIABLE(8, FLOAT64, u, INPUT),     VARIABLE(9, FLOAT64, y, OUTPUT),
    VARIABLE(1, UINT64, m, STRUCTURAL), VARIABLE(2, UINT64, n, STRUCTURAL), VARIABLE(3, UINT64, r, STRUCTURAL),
    VARIABLE(10, BOOLEAN, deaf, STRUCTURAL),
};

static void start(Model *m) {
    static const double A[] = {0, 1, -4, -1}, B[] = {0, 1}, C[] = {1, 0, 0, 1}, x0[] = {0.5, 0.5};
    m->m = 1, m->n = m->r = 2;
    memcpy(m->A, A, sizeof A), memcpy(m->B, B, sizeof B), memcpy(m->C, C, sizeof C), memcpy(m->x0, x0, sizeof x0);
    m->u[0] = 1;
}

static size_t elements(const Model *m, const Variable *v) {
    const size_t counts[] = {m->n * m->n, m->n * m->m, m->r * m->n, m->n, m->m, m->r};
    return counts[v->reference - 4];
}

static int enter_configuration(Model *m) {
    for (int k = 0; k < 5; k++) m->before[k] = elements(m, &variables[k]);
    return OK;
}

static int exit_configuration(Model *m) {
    for (int k = 0; k < 5; k++) {
        double *numbers = (double *)((char *)m + variables[k].offset);
        const size_t n = elements(m, &variables[k]);
        for (size_t j = 0; j < n && n != m->before[k]; j++) numbers[j] = NAN;
    }
    return OK;
}

static int forbids(Model *m, unsigned r, const void *set) { return set && r < 4 && *(const uint64_t *)set > MOST; }

static void changed(Model *m, unsigned r) { m->deaf = 0; }

static void compute_outputs(Model *m) {
    for (size_t k = 0; k < m->r; k++) {
        m->y[k] = 0;
        for (size_t j = 0; j < m->n; j++) m->y[k] += m->C[k * m->n + j] * m->x[j];
    }
}

static int enter_initialization(Model *m) {
    memcpy(m->x, m->x0, sizeof m->x);
    compute_outputs(m);
    return OK;
}

static int step(Model *m, double t, double h, Step *s) {
    double rates[MOST] = {0};
    for (size_t k = 0; k < m->n; k++) {
        for (size_t j = 0; j < m->n; j++) rates[k] += m->A[k * m->n + j] * m->x[j];
        for (size_t j = 0; j < m->m; j++) rates[k] += m->B[k * m->m + j] * m->u[j];
    }
    for (size_t k = 0; k < m->n; k++) m->x[k] += h * rates[k];
    compute_outputs(m);
    return OK;
}

static const Toy toy = {
    MODEL(variables), .start = start, .count = elements, .enter_configuration = enter_configuration,
    .exit_configuration = exit_configuration, .forbids = forbids, .changed = changed,
    .enter_initialization = enter_initialization, .step = step,
};
