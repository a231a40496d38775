/* An FMI 2.0 co-simulation FMU that integrates its input: x' = gain u.
 *
 * As FMUs of 20-sim do, it sets all variables back in fmi2SetupExperiment, and does not in fmi2Reset. If
 * `stubborn` is true it does not take other start values at all. It limits `share`, and keeps `angle`
 * in degrees. From the time `slow_from` on each step takes `pause` seconds. It rejects a huge `gain` or
 * `share` with fmi2Error, and all further values, too. After a huge `guess` it answers reading with
 * fmi2Fatal, and aborts if it is called again.
 */
#define _POSIX_C_SOURCE 199309L
#define FMI 2
#include "toyfmu.h"

#include <time.h>

enum { U, GAIN, SHARE, ANGLE, SLOW_FROM, PAUSE, X, GUESS, TOLERANCE, REALS };
#define DEGREE (3.14159265358979323846 / 180.0)
#define HUGE_VALUE 1e200

struct Model {
    COMMON;
    double reals[REALS];
    int count, choice, stubborn, failed;
    char label[64];
};

#define REAL(name) VARIABLE(name, FLOAT64, reals[name], ANY_MODE)
static const Variable variables[] = {
    REAL(U), REAL(GAIN), REAL(SHARE), REAL(ANGLE), REAL(SLOW_FROM), REAL(PAUSE), REAL(X), REAL(GUESS), REAL(TOLERANCE),
    VARIABLE(0, INT32, count, ANY_MODE), VARIABLE(1, INT32, choice, ANY_MODE),
    VARIABLE(0, BOOLEAN, stubborn, ANY_MODE), VARIABLE(0, STRING, label, ANY_MODE),
};

static void start(Model *m) {
    static const double first[REALS] = {1.0, 1.0, 0.5, 0.0, 1e300};
    memcpy(m->reals, first, sizeof first);
    m->count = m->choice = 1;
    m->stubborn = m->failed = 0;
    strcpy(m->label, "none");
}

static int set_up(Model *m, int has_tolerance, double tolerance) {
    const double x = m->reals[X];
    start(m);
    m->reals[X] = x; /* which fmi2Reset leaves as it is, too */
    m->reals[TOLERANCE] = has_tolerance ? tolerance : 0.0;
    return OK;
}

static int reset(Model *m) { return OK; }

static int exit_initialization(Model *m) {
    if (m->stubborn) {
        const double tolerance = m->reals[TOLERANCE];
        start(m);
        m->stubborn = 1, m->reals[TOLERANCE] = tolerance;
    }
    m->reals[SHARE] = fmin(fmax(m->reals[SHARE], 0.0), 1.0);
    m->failed = m->reals[GUESS] > HUGE_VALUE;
    m->reals[GUESS] = 42.0;
    return OK;
}

static int before(Model *m, const char *function) {
    if (strcmp(function, "fmi2GetReal")) return OK;
    if (m->failed && m->failed++ > 1) abort();
    return m->failed ? FATAL : OK;
}

static int forbids(Model *m, unsigned r, const void *set) {
    const double *value = set;
    m->failed |= value && (r == GAIN || r == SHARE) && *value > HUGE_VALUE;
    return value && m->failed;
}

static void changed(Model *m, unsigned r) {
    if (r == ANGLE) m->reals[ANGLE] = m->reals[ANGLE] / DEGREE * DEGREE;
}

static int step(Model *m, double time, double size, Step *s) {
    if (time >= m->reals[SLOW_FROM]) {
        const double whole = floor(m->reals[PAUSE]);
        struct timespec pause = {(time_t)whole, (long)(1e9 * (m->reals[PAUSE] - whole))};
        while (nanosleep(&pause, &pause) != 0) continue; /* a signal does not end the step */
    }
    m->reals[X] += size * m->reals[GAIN] * m->reals[U];
    return OK;
}

static const Toy toy = {
    MODEL(variables), .start = start, .set_up = set_up, .reset = reset, .exit_initialization = exit_initialization,
    .before = before, .forbids = forbids, .changed = changed, .step = step,
};
