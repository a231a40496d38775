/* One instance of the faulty model: its memory, what it says to the host, and checks of calls. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#ifndef MODEL_GUID
#define MODEL_GUID "{faulty}"
#endif
#ifndef ROLLBACK
#define ROLLBACK 1 /* whether the FMU has states */
#endif
#ifndef INTERPOLATE
#define INTERPOLATE 1 /* whether inputs may have derivatives */
#endif

/* Value references of the Real variables; that of the Integer parameter follows. */
enum { U, A, B, AT, LONGEST, Y, Z, N_REALS, FAULT = N_REALS };

/* Phases of the FMI state machine, as bits, so that a call can name several. */
enum { INSTANTIATED = 1, INITIALIZATION = 2, STEP = 4, TERMINATED = 8, FAILED = 16 };

/* Everything that evolves or was set; without padding, so that equal states have equal bytes. */
typedef struct {
    double time, x, u_rate;
    double reals[N_REALS];
    int phase, fault;
} State;

typedef struct {
    State now;
    char *name;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    int serial;              /* counts instances from 1 on */
    int logging;             /* whether events are logged; anything else always is */
    int terminates;          /* whether the last step asked to end the run */
    fmi2Status step_status;  /* of the last step */
    double no_return_before; /* the host said that it will not go back to earlier times */
} Instance;

static atomic_int states, instances, rollbacks, calls_after_fatal; /* see faulty.c */
static atomic_int born, dead_up_to;                                /* serials */

/* ---- messages -------------------------------------------------------------------------- */

#define TOLD "the faulty model was told " /* how messages of faults begin */

/* Log a message, which must come out without any %; returns the status. */
static fmi2Status say(const Instance *instance, fmi2Status status, const char *format, ...) {
    static const char *const categories[] = {"logEvents",      "logStatusWarning", "logStatusDiscard",
                                             "logStatusError", "logStatusFatal",   "logStatusPending"};
    char message[512];
    va_list arguments;
    if (instance->logger == NULL || (status == fmi2OK && !instance->logging)) return status;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    instance->logger(instance->environment, instance->name, status, categories[status], message);
    return status;
}

/* After fmi2Error an instance can be asked for values, set back, reset or freed, and nothing else. */
#define REFUSE(instance, ...) \
    ((instance)->now.phase = FAILED, say((instance), fmi2Error, __VA_ARGS__))

/* ---- checks ---------------------------------------------------------------------------- */

static const char *phase_name(int phase) {
    switch (phase) {
        case INSTANTIATED: return "instantiated";
        case INITIALIZATION: return "initialization";
        case STEP: return "step";
        case TERMINATED: return "terminated";
        default: return "failed";
    }
}

static fmi2Status require(Instance *instance, int phases, const char *action) {
    const int phase = instance->now.phase;
    if (phase & phases) return fmi2OK;
    return REFUSE(instance, "cannot %s in phase %s.", action, phase_name(phase));
}

/* fmi2Fatal ends all instances of that moment; tests look for this message, or for the count. */
static int is_dead(const Instance *instance, const char *function) {
    if (instance->serial > dead_up_to) return 0;
    calls_after_fatal++;
    fprintf(stderr, "%s called after fmi2Fatal\n", function);
    fflush(stderr);
    return 1;
}

#define ALIVE(instance) \
    if (is_dead((instance), __func__)) return fmi2Fatal

#endif
