/* An FMI 2.0 co-simulation FMU with outputs and locals of all types. All follow from time t and input u:
 *
 * x = integral of u, half = x / 2, count = first + whole tenths of a second, twice = 2 count,
 * high = x > 0.25 (returned as 7, which counts as true), odd = count is odd, mode = 1, 2 or 4,
 * text = "count is ..., high|low", note = a text with a quote, a comma, a line break and UTF-8.
 */
#define FMI 2
#include "toyfmu.h"

struct Model {
    COMMON;
    double u, x;
    int first, crash_at, fail_at, on;
    int reads; /* calls that read Strings, which no state keeps, as all that follows */
    double half;
    int count, twice, choice, high, odd;
    char text[64], note[64];
};

static const Variable variables[] = {
    VARIABLE(0, FLOAT64, u, ANY_MODE),      VARIABLE(1, FLOAT64, x, OUTPUT),         VARIABLE(2, FLOAT64, half, OUTPUT),
    VARIABLE(0, INT32, first, ANY_MODE),    VARIABLE(1, INT32, count, OUTPUT),       VARIABLE(2, INT32, twice, OUTPUT),
    VARIABLE(3, INT32, choice, OUTPUT),     VARIABLE(4, INT32, crash_at, ANY_MODE),  VARIABLE(5, INT32, fail_at, ANY_MODE),
    VARIABLE(6, INT32, reads, OUTPUT),      VARIABLE(0, BOOLEAN, high, OUTPUT),      VARIABLE(1, BOOLEAN, odd, OUTPUT),
    VARIABLE(2, BOOLEAN, on, ANY_MODE),     VARIABLE(0, STRING, text, OUTPUT),       VARIABLE(1, STRING, note, OUTPUT),
};

static void start(Model *m) {
    m->u = 1.0;
    m->crash_at = m->fail_at = -1;
}

static int tenths(const Model *m) { return m->first + (int)floor(m->time / 0.1 + 1e-6); }

static int before(Model *m, const char *function) {
    m->reads += !strcmp(function, "fmi2GetString");
    return !strcmp(function, "fmi2GetInteger") && m->fail_at >= 0 && tenths(m) >= m->fail_at ? ERROR : OK;
}

static void compute(Model *m) {
    m->half = m->x / 2.0;
    m->count = tenths(m);
    m->twice = 2 * m->count;
    m->choice = m->x < 0.2 ? 1 : m->x < 0.4 ? 2 : 4;
    m->high = 7 * (m->x > 0.25);
    m->odd = m->count % 2;
    snprintf(m->text, sizeof m->text, "count is %d, %s", m->count, m->high ? "high" : "low");
    strcpy(m->note, "a \"quote\", a comma,\na line, \xc3\xa9");
}

static int step(Model *m, double time, double size, Step *s) {
    if (m->crash_at >= 0 && tenths(m) >= m->crash_at) abort();
    m->x += size * m->u;
    m->time = time + size;
    return OK;
}

static const Toy toy = {
    MODEL(variables), .state_size = offsetof(Model, reads), .start = start, .before = before, .compute = compute,
    .step = step,
};
