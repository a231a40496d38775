/* The equations x' = a u, y = x + b u, z = x, and what goes wrong with them. */
#ifndef MODEL_H
#define MODEL_H

#include "instance.h"

#ifdef _WIN32
#define fork() 0
#define sleep(seconds) (void)(seconds)
#include <io.h>
#else
#include <unistd.h>
#endif

/* Values of the parameter `fault`. */
enum {
    NO_FAULT,
    DISCARD,
    ERROR,
    FATAL,
    NAN_Y,
    TERMINATE,
    GET_REAL,
    SET_REAL,
    NAN_Z,
    PENDING,
    EXIT_INITIALIZATION,
    ENTER_INITIALIZATION,
    GET_STATE,
    WARNING,
    EXIT,
    SEGFAULT,
    ABORT,
    HANG,
    SEGFAULT_GET_REAL,
    SEGFAULT_INITIALIZATION,
    SEGFAULT_TERMINATE,
    SEGFAULT_FREE,
    SEGFAULT_FREE_STATE,
    NEGATIVE,
    HUGE_STATE,
    ORPHAN,
    GARBLE,
    HANG_TERMINATE,
    N_FAULTS
};

#define TIME_TOLERANCE 1e-9 /* in s; a step that ends at `at` does not pass it */
#define STEP_TOLERANCE 1e-3 /* how far the host's times may be off, as a part of the step */

static void set_start_values(State *now) {
    memset(now, 0, sizeof *now);
    now->reals[A] = 1.0;
    now->reals[AT] = now->reals[LONGEST] = 1e300;
    now->phase = INSTANTIATED;
}

/* Whether the time at which this fault begins is over. */
static int has_fault(const State *now, int fault, double time) {
    return now->fault == fault && time > now->reals[AT] + TIME_TOLERANCE;
}

static void evaluate_outputs(State *now) {
    double *v = now->reals;
    v[Y] = has_fault(now, NAN_Y, now->time) ? NAN : now->x + v[B] * v[U];
    v[Z] = has_fault(now, NAN_Z, now->time) ? NAN : now->x;
}

/* Exact for an input that is a straight line; its derivative holds for one step. */
static void advance(State *now, double end) {
    const double step = end - now->time;
    now->x += now->reals[A] * step * (now->reals[U] + 0.5 * step * now->u_rate);
    now->reals[U] += step * now->u_rate;
    now->u_rate = 0.0;
    now->time = end;
    evaluate_outputs(now);
}

static volatile unsigned hung;

/* The process ends if the fault is the one that does it here. */
static void maybe_die(const State *now, int fault) {
    if (now->fault == fault) raise(SIGSEGV);
}

/* A step that passes `at`. The FMU stays as it was, unless said otherwise. */
static fmi2Status faulty_step(Instance *instance, double end) {
    State *now = &instance->now;
    const double at = now->reals[AT];
    const int begins = now->time <= at + TIME_TOLERANCE;
    switch (now->fault) {
        case DISCARD:
            return say(instance, fmi2Discard, TOLD "to discard the step to t = %.9g s.", end);
        case ERROR: return REFUSE(instance, TOLD "to fail in the step to t = %.9g s.", end);
        case FATAL:
            dead_up_to = born;
            return say(instance, fmi2Fatal, TOLD "to die in the step to t = %.9g s.", end);
        case NEGATIVE:
            say(instance, fmi2Error, TOLD "to answer -1 to the step to t = %.9g s.", end);
            return (fmi2Status)-1;
        case PENDING:
            return say(instance, fmi2Pending, TOLD "not to finish the step to t = %.9g s.", end);
        case TERMINATE: /* goes as far as `at` */
            if (at > now->time) advance(now, at);
            instance->terminates = 1;
            return say(instance, fmi2Discard, TOLD "to end the run at t = %.9g s.", now->time);
        case WARNING: /* goes on */
            advance(now, end);
            return say(instance, fmi2Warning, TOLD "to warn of the step to t = %.9g s.", end);
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
                say(instance, fmi2OK, TOLD "to make %c NaN in the step to t = %.9g s.",
                    now->fault == NAN_Y ? 'y' : 'z', end);
            break;
        default: break;
    }
    advance(now, end);
    return fmi2OK;
}

static fmi2Status do_step(Instance *instance, double time, double step) {
    State *now = &instance->now;
    const double end = time + step;
    if (!(step > 0.0 && isfinite(end)))
        return REFUSE(instance, "the step size %.9g s is not a positive, finite number.", step);
    if (!(fabs(time - now->time) <= STEP_TOLERANCE * step))
        return REFUSE(instance, "the step starts at t = %.9g s, but the faulty model is at t = %.9g s.",
                      time, now->time);
    if (step > now->reals[LONGEST] * (1.0 + TIME_TOLERANCE))
        return say(instance, fmi2Discard, "the step of %.9g s is longer than the longest of %.9g s.", step,
                   now->reals[LONGEST]);
    if (has_fault(now, now->fault, end)) return faulty_step(instance, end);
    advance(now, end);
    return fmi2OK;
}

#endif
