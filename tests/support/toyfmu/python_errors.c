/* An FMU of FMI 2.0 or 3.0, for co-simulation or (macro EXCHANGE) Model Exchange, with x' = 1 and y = x + u. It leaves
 * an exception of Python in the interpreter of its host, if that has one, as FMUs that use Python can: in calls of
 * the function that its parameter `function` names (DoStep), from the time `at` on. These calls return `status`.
 * With a `message`, they log it instead. With macro LOADS or CREATES, loading its library or instantiating it
 * leaves an exception, too.
 */
#define _GNU_SOURCE
#include "toyfmu.h"

#ifndef _WIN32
#include <dlfcn.h>
#endif

enum { U, X, DX, Y, AT, FUNCTION, STATUS, TIME, MESSAGE };

struct Model {
    COMMON;
    double u, x, dx, y, at;
    char function[64], message[64];
    int status;
};

static const Variable variables[] = {
    VARIABLE(U, FLOAT64, u, INPUT), VARIABLE(X, FLOAT64, x, PARAMETER), VARIABLE(DX, FLOAT64, dx, OUTPUT),
    VARIABLE(Y, FLOAT64, y, OUTPUT), VARIABLE(AT, FLOAT64, at, PARAMETER),
    VARIABLE(FUNCTION, STRING, function, PARAMETER), VARIABLE(STATUS, INT32, status, PARAMETER),
    VARIABLE(TIME, FLOAT64, time, OUTPUT), VARIABLE(MESSAGE, STRING, message, PARAMETER),
};

__attribute__((unused)) static void leave_exception(void) {
#ifndef _WIN32
    void **kind = dlsym(RTLD_DEFAULT, "PyExc_ValueError");
    void (*set)(void *, const char *) = (void (*)(void *, const char *))dlsym(RTLD_DEFAULT, "PyErr_SetString");
    int (*lock)(void) = (int (*)(void))dlsym(RTLD_DEFAULT, "PyGILState_Ensure");
    void (*unlock)(int) = (void (*)(int))dlsym(RTLD_DEFAULT, "PyGILState_Release");
    if (!kind || !set || !lock || !unlock) return;
    const int state = lock();
    set(*kind, "no variable\n17");
    unlock(state);
#endif
}

#ifdef LOADS
__attribute__((constructor)) static void load(void) { leave_exception(); }
#endif

static void created(Model *m) {
#ifdef CREATES
    leave_exception();
#endif
}

static int before(Model *m, const char *function) {
    if (strcmp(function + strlen("fmi2"), m->function) || m->time < m->at - 1e-9) return OK;
    if (*m->message) return say(m, m->status, "%s", m->message);
    leave_exception();
    return m->status;
}

static void start(Model *m) {
    m->dx = 1.0;
    m->at = START_TIME;
    strcpy(m->function, START_FUNCTION);
}

static void compute(Model *m) { m->y = m->x + m->u; }

static int step(Model *m, double time, double size, Step *s) {
    m->x += size;
    m->time = s->last = time + size;
    return OK;
}

static int update(Model *m, Update *u) { return OK; }

static void derivatives(Model *m, double dx[]) { dx[0] = 1.0; }

static const Toy toy = {
    MODEL(variables), .exchange = EXCHANGE, .states = 1, .state_offset = offsetof(Model, x), .before = before,
    .start = start, .created = created, .compute = compute, .step = step, .update = update, .derivatives = derivatives,
};
