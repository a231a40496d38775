/* An FMI 2.0 co-simulation FMU with x' = a u, y = x + b u, z = x that misbehaves as its parameter `fault` says, from
 * the time `at` on.
 *
 * Calls that the standard forbids it refuses with fmi2Error and a message. Besides the functions
 * of FMI it exports counts over all instances since the library was loaded:
 *
 *     faulty_instances            instances made and not freed
 *     faulty_states               FMU states made and not freed
 *     faulty_rollbacks            how often a state was set
 *     faulty_calls_after_fatal    calls of anything but fmi2FreeInstance after fmi2Fatal
 */
#define FMI 2
#include "toyfmu.h"

#include <signal.h>
#include <stdatomic.h>

#ifdef _WIN32
#define fork() 0
#define sleep(seconds) (void)(seconds)
#include <io.h>
#else
#include <unistd.h>
#endif

enum { U, A, B, AT, LONGEST, Y, Z, REALS, FAULT = REALS }; /* value references */

enum { /* values of the parameter `fault` */
    NO_FAULT, DISCARD, FAIL, DIE, NAN_Y, TERMINATE, GET_REAL, SET_REAL, NAN_Z, PEND, EXIT_INITIALIZATION,
    ENTER_INITIALIZATION, GET_STATE, WARN, EXIT, SEGFAULT, ABORT, HANG, SEGFAULT_GET_REAL, SEGFAULT_INITIALIZATION,
    SEGFAULT_TERMINATE, SEGFAULT_FREE, SEGFAULT_FREE_STATE, NEGATIVE, HUGE_STATE, ORPHAN, GARBLE, HANG_TERMINATE, SET_STATE,
    SET_DERIVATIVE, FAULTS
};

#define TIME_TOLERANCE 1e-9 /* in s; a step that ends at `at` does not pass it */
#define STEP_TOLERANCE 1e-3 /* how far the host's times may be off, as a part of the step */

struct Model {
    COMMON;
    double x, u_rate, reals[REALS];
    int fault;
    int serial;              /* counts instances from 1 on; no state keeps it and what follows */
    int terminates;          /* whether the last step asked to end the run */
    Status step_status;      /* of the last step */
    double no_return_before; /* the host promised not to go back to earlier times */
};

#define REAL(name, settable) VARIABLE(name, FLOAT64, reals[name], settable)
static const Variable variables[] = {
    REAL(U, INPUT), REAL(A, PARAMETER), REAL(B, PARAMETER), REAL(AT, PARAMETER), REAL(LONGEST, PARAMETER),
    REAL(Y, OUTPUT), REAL(Z, OUTPUT), VARIABLE(FAULT, INT32, fault, PARAMETER),
};

static atomic_int states, instances, rollbacks, calls_after_fatal, created_instances, dead_up_to;

FMI2_Export int faulty_instances(void);
FMI2_Export int faulty_states(void);
FMI2_Export int faulty_rollbacks(void);
FMI2_Export int faulty_calls_after_fatal(void);

int faulty_instances(void) { return instances; }
int faulty_states(void) { return states; }
int faulty_rollbacks(void) { return rollbacks; }
int faulty_calls_after_fatal(void) { return calls_after_fatal; }

/* After fmi2Error an instance can be asked for values, set back, reset or freed, and nothing else. */
#define REFUSE(m, ...) ((m)->mode = FAILED, say((m), ERROR, __VA_ARGS__))
#define TOLD "the faulty model was told " /* how messages of faults begin */

/* Whether the time at which this fault begins is over. */
static int has_fault(const Model *m, int fault, double time) {
    return m->fault == fault && time > m->reals[AT] + TIME_TOLERANCE;
}

static void start(Model *m) {
    m->reals[A] = 1.0;
    m->reals[AT] = m->reals[LONGEST] = 1e300;
    m->terminates = 0;
    m->step_status = fmi2OK;
    m->no_return_before = -HUGE_VAL;
}

static void created(Model *m) {
    m->serial = ++created_instances;
    instances++;
}

static void freed(Model *m) {
    if (m->fault == SEGFAULT_FREE) raise(SIGSEGV);
    instances--;
}

static volatile unsigned hung;

/* What goes wrong in calls other than steps; fmi2Fatal ends all instances of that moment. */
static int before(Model *m, const char *function) {
    static const struct {
        const char *function;
        int fault, at_once;
        const char *message; /* SIGSEGV without one */
    } faults[] = {
        {"fmi2EnterInitializationMode", ENTER_INITIALIZATION, 1, "not to enter initialization mode."},
        {"fmi2ExitInitializationMode", EXIT_INITIALIZATION, 1, "not to exit initialization mode."},
        {"fmi2ExitInitializationMode", SEGFAULT_INITIALIZATION, 1, NULL},
        {"fmi2Terminate", SEGFAULT_TERMINATE, 1, NULL},
        {"fmi2FreeFMUstate", SEGFAULT_FREE_STATE, 1, NULL},
        {"fmi2GetReal", GET_REAL, 0, "to refuse getting values at t = %.9g s."},
        {"fmi2GetReal", SEGFAULT_GET_REAL, 0, NULL},
        {"fmi2SetReal", SET_REAL, 0, "to refuse setting values at t = %.9g s."},
        {"fmi2SetRealInputDerivatives", SET_DERIVATIVE, 0, "to refuse derivatives at t = %.9g s."},
        {"fmi2GetFMUstate", GET_STATE, 0, "to refuse its state at t = %.9g s."},
        {"fmi2SetFMUstate", SET_STATE, 0, "to refuse another state at t = %.9g s."},
    };
    if (m->serial <= dead_up_to && m->serial) {
        calls_after_fatal++;
        fprintf(stderr, "%s called after fmi2Fatal\n", function);
        fflush(stderr);
        return FATAL;
    }
    if (!ROLLBACK && strstr(function, "FMUstate"))
        return REFUSE(m, "%s called, but the faulty model has no states.", function);
    for (size_t k = 0; k < sizeof faults / sizeof faults[0]; k++) {
        if (strcmp(function, faults[k].function) || m->fault != faults[k].fault) continue;
        if (!faults[k].at_once && !has_fault(m, m->fault, m->time)) continue;
        if (!faults[k].message) raise(SIGSEGV);
        char text[128];
        snprintf(text, sizeof text, "%s%s", TOLD, faults[k].message);
        return REFUSE(m, text, m->time);
    }
    return OK;
}

static int wrong_mode(Model *m, const char *function) {
    return REFUSE(m, "%s cannot be called in this mode%s.", function, m->mode == FAILED ? ", after an error" : "");
}

static int refused(Model *m, const char *function, unsigned reference) {
    return REFUSE(m, "%s: the variable %u does not exist, or cannot be set now.", function, reference);
}

static int forbids(Model *m, unsigned reference, const void *set) {
    const int *fault = set;
    return fault && reference == FAULT && (*fault < 0 || *fault >= FAULTS);
}

static int compute_outputs(Model *m) {
    double *v = m->reals;
    v[Y] = has_fault(m, NAN_Y, m->time) ? NAN : m->x + v[B] * v[U];
    v[Z] = has_fault(m, NAN_Z, m->time) ? NAN : m->x;
    return OK;
}

static void changed(Model *m, unsigned reference) {
    if (m->mode == INITIALIZATION) compute_outputs(m);
}

static int terminate(Model *m) {
    while (m->fault == HANG_TERMINATE) hung++;
    return OK;
}

/* ---- steps ------------------------------------------------------------------------------------ */

static int set_input_derivative(Model *m, unsigned reference, int order, double rate) {
    if (!INTERPOLATE) return REFUSE(m, "the faulty model cannot interpolate inputs.");
    if (reference != U || order != 1) return REFUSE(m, "only u has a derivative, of order 1.");
    m->u_rate = rate;
    return OK;
}

/* Exact for an input that is a straight line; its derivative holds for one step. */
static void advance(Model *m, double end) {
    const double size = end - m->time;
    m->x += m->reals[A] * size * (m->reals[U] + 0.5 * size * m->u_rate);
    m->reals[U] += size * m->u_rate;
    m->u_rate = 0.0;
    m->time = end;
    compute_outputs(m);
}

/* A step that passes `at`. The FMU stays as it was, unless a comment tells otherwise. */
static int faulty_step(Model *m, double end) {
    const double at = m->reals[AT];
    const int begins = m->time <= at + TIME_TOLERANCE;
    switch (m->fault) {
        case DISCARD: return say(m, DISCARDED, TOLD "to discard the step to t = %.9g s.", end);
        case FAIL: return REFUSE(m, TOLD "to fail in the step to t = %.9g s.", end);
        case DIE:
            dead_up_to = created_instances;
            return say(m, FATAL, TOLD "to die in the step to t = %.9g s.", end);
        case NEGATIVE:
            say(m, ERROR, TOLD "to answer -1 to the step to t = %.9g s.", end);
            return -1;
        case PEND: return say(m, PENDING, TOLD "not to finish the step to t = %.9g s.", end);
        case TERMINATE: /* goes as far as `at` */
            if (at > m->time) advance(m, at);
            m->terminates = 1;
            return say(m, DISCARDED, TOLD "to end the run at t = %.9g s.", m->time);
        case WARN: /* goes on */
            advance(m, end);
            return say(m, WARNING, TOLD "to warn of the step to t = %.9g s.", end);
        case EXIT: exit(0);
        case SEGFAULT: raise(SIGSEGV); break;
        case ABORT: abort();
        case ORPHAN:
            if (fork() > 0) _exit(3);
            sleep(40);
            _exit(0);
        case GARBLE:
            for (int file = 3; file < 64; file++)
                if (write(file, "\0\0\0\0garbage", 11) < 0) continue;
            break;
        case HANG: {
            const char *mark = getenv("FAULTY_HANGS");
            FILE *file = mark != NULL ? fopen(mark, "w") : NULL;
            if (file != NULL) fclose(file);
            for (;;) hung++;
        }
        case NAN_Y:
        case NAN_Z: /* go on */
            if (begins)
                say(m, OK, TOLD "to make %c NaN in the step to t = %.9g s.", m->fault == NAN_Y ? 'y' : 'z', end);
            break;
        default: break;
    }
    advance(m, end);
    return OK;
}

static int try_step(Model *m, double time, double size) {
    const double end = time + size;
    if (!(size > 0.0 && isfinite(end)))
        return REFUSE(m, "the step size %.9g s is not a positive, finite number.", size);
    if (!(fabs(time - m->time) <= STEP_TOLERANCE * size))
        return REFUSE(m, "the step starts at t = %.9g s, but the faulty model is at t = %.9g s.", time, m->time);
    if (size > m->reals[LONGEST] * (1.0 + TIME_TOLERANCE))
        return say(m, DISCARDED, "the step of %.9g s is longer than the longest of %.9g s.", size, m->reals[LONGEST]);
    if (has_fault(m, m->fault, end)) return faulty_step(m, end);
    advance(m, end);
    return OK;
}

static int step(Model *m, double time, double size, Step *s) {
    m->terminates = 0;
    const int status = try_step(m, time, size);
    m->step_status = (Status)status;
    if (status <= WARNING && s->no_return) m->no_return_before = time;
    return status;
}

static int cancel(Model *m) {
    if (m->step_status != fmi2Pending) return REFUSE(m, "no step is pending.");
    m->step_status = fmi2Discard;
    return OK;
}

/* A pending step stays so until it is cancelled. */
static int get_status(Model *m, int kind, void *value) {
    switch (kind) {
        case fmi2DoStepStatus: *(fmi2Status *)value = m->step_status; return OK;
        case fmi2LastSuccessfulTime: *(fmi2Real *)value = m->time; return OK;
        case fmi2Terminated: *(fmi2Boolean *)value = m->terminates; return OK;
        case fmi2PendingStatus: *(fmi2String *)value = ""; return OK;
        default: return DISCARDED;
    }
}

/* ---- states ----------------------------------------------------------------------------------- */

static int set_state_hook(Model *m, const Model *state) {
    if (state->time < m->no_return_before)
        return REFUSE(m, "set back to t = %.9g s, though noSetFMUStatePriorToCurrentPoint was given at t = %.9g s.",
                      state->time, m->no_return_before);
    rollbacks++;
    return OK;
}

static void count_state(int change) { states += change; }

static size_t state_bytes(const Model *m) {
    return has_fault(m, HUGE_STATE, m->time) ? (size_t)1 << 60 : offsetof(Model, serial);
}

static const Toy toy = {
    MODEL(variables), .state_size = offsetof(Model, serial), .before = before, .wrong_mode = wrong_mode,
    .refused = refused, .start = start, .created = created, .freed = freed, .enter_initialization = compute_outputs,
    .terminate = terminate, .step = step, .forbids = forbids, .changed = changed, .set_state = set_state_hook,
    .count_state = count_state, .state_bytes = state_bytes, .set_input_derivative = set_input_derivative,
    .cancel = cancel, .status = get_status,
};
