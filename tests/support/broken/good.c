/* An FMI 2.0 FMU that is as it should be, for co-simulation and for model exchange: a mass on a spring,
 *
 *     x' = v,   v' = gain u - K x - C v,   total = x + w / 2,   moving = x > THRESHOLD.
 *
 * A name in resources/fault.txt makes one thing of it wrong; dynamic.py lists them. Functions that a fault changes
 * call those of toyfmu.h, which have other names here.
 */
#define _DEFAULT_SOURCE /* clock_gettime, usleep */
#include <signal.h>
#include <time.h>
#include <unistd.h>

#include "fmi2Functions.h"

#undef fmi2Instantiate
#undef fmi2SetDebugLogging
#undef fmi2SetFMUstate
#undef fmi2SerializedFMUstateSize
#undef fmi2DeSerializeFMUstate
#undef fmi2GetDirectionalDerivative
#undef fmi2GetRealOutputDerivatives
#define fmi2Instantiate toy_instantiate
#define fmi2SetDebugLogging toy_set_logging
#define fmi2SetFMUstate toy_set_state
#define fmi2SerializedFMUstateSize toy_size
#define fmi2DeSerializeFMUstate toy_deserialize
#define fmi2GetDirectionalDerivative toy_directional
#define fmi2GetRealOutputDerivatives toy_output_derivatives
#ifndef FAULT /* memory.c, which has other faults, calls these two by the same names */
#undef fmi2GetFMUstate
#undef fmi2SerializeFMUstate
#define fmi2GetFMUstate toy_get_state
#define fmi2SerializeFMUstate toy_serialize
#endif
#define FMI 2
#include "toyfmu.h"
#undef fmi2Instantiate
#undef fmi2SetDebugLogging
#undef fmi2SetFMUstate
#undef fmi2SerializedFMUstateSize
#undef fmi2DeSerializeFMUstate
#undef fmi2GetDirectionalDerivative
#undef fmi2GetRealOutputDerivatives
#ifndef FAULT
#undef fmi2GetFMUstate
#undef fmi2SerializeFMUstate
#endif

enum { U, W, GAIN, POSITION, SPEED, ACCELERATION, TOTAL, X, V, DER_X, DER_V, TIME, N_REALS };
enum { MOVING };
enum { EVENTS, WARNINGS, ERRORS, N_CATEGORIES };

#define K 40.0
#define C 1.0
#define THRESHOLD 0.02
#define SUBSTEP 1e-3  /* s, of the integration */
#define LATER 0.5     /* s, when faults of steps begin */
#define BLOCKS 64     /* of memory, that some faults use */
#define MAGIC 0x600dU /* what the bytes of a state begin with */

struct Model {
    COMMON;
    double real[N_REALS], before[4]; /* position, speed, time and w before the last step */
    int moving, poison, last_set, steps;
    int is_model, terminates, discards, shown[N_CATEGORIES]; /* no state keeps these */
};

#define KEPT_SIZE offsetof(Model, is_model)
#define REAL(name, settable) VARIABLE(name, FLOAT64, real[name], settable)
static const Variable variables[] = {
    REAL(U, INPUT), REAL(W, INPUT), REAL(GAIN, PARAMETER), REAL(POSITION, OUTPUT), REAL(SPEED, OUTPUT),
    REAL(ACCELERATION, OUTPUT), REAL(TOTAL, OUTPUT), REAL(X, PARAMETER), REAL(V, PARAMETER), REAL(DER_X, OUTPUT),
    REAL(DER_V, OUTPUT), REAL(TIME, OUTPUT), VARIABLE(MOVING, BOOLEAN, moving, OUTPUT),
};

typedef struct {
    unsigned magic, check;
    const double *place; /* used by a fault only */
    char state[KEPT_SIZE];
} Bytes;

static const char *const CATEGORIES[] = {"logEvents", "logStatusWarning", "logStatusError"};
static char fault[32];
static double shared[2], scratch, kept;
static volatile unsigned spins;
static void *volatile taken; /* keeps the compiler from removing an allocation */

#define IS(name) (strcmp(fault, #name) == 0)

/* ---- messages and modes ---------------------------------------------------------------- */

static int tell(const Model *m, int status, const char *format, ...) {
    const int category = status == OK ? EVENTS : status == WARNING ? WARNINGS : ERRORS;
    const Host *host = host_of(m);
    char text[256];
    va_list arguments;
    int is_shown = status != OK || (host->logging && m->shown[category]);
    if (IS(CATEGORY) && host->logging) is_shown = 1;
    if (IS(LOG_OFF)) is_shown = 1;
    if (!is_shown || (IS(SILENT) && status >= ERROR)) return status;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    host->logger(IS(OTHER_ENVIRONMENT) ? (void *)m : host->environment, host->name, (Status)status, CATEGORIES[category],
                 text);
    return status;
}

#define REFUSE(m, ...) ((m)->mode = FAILED, tell((m), ERROR, __VA_ARGS__))

static int before(Model *m, const char *function) {
    const char *crashes = IS(TERMINATE_CRASH) && !m->is_model ? "fmi2Terminate"
                          : IS(FREE_STATE_CRASH)              ? "fmi2FreeFMUstate"
                          : IS(MODEL_CRASH)                   ? "fmi2GetDerivatives"
                                                              : "";
    if (!strcmp(function, crashes)) raise(SIGSEGV);
    if (IS(SHARED) && !m->is_model) memcpy(m->real + X, shared, sizeof shared);
    return OK;
}

static int wrong_mode(Model *m, const char *function) {
    if (IS(PHASE_CRASH) && m->mode == INSTANTIATED && !strcmp(function, "fmi2DoStep")) raise(SIGSEGV);
    if (IS(PHASE_ACCEPTED) && m->mode == TERMINATED && !strcmp(function, "fmi2DoStep")) return OK;
    return REFUSE(m, "%s does not belong in this mode.", function);
}

static int refused(Model *m, const char *function, unsigned reference) {
    if (!m->discards) return REFUSE(m, "%s: there is no variable %u that it can use now.", function, reference);
    m->discards = 0;
    return tell(m, DISCARDED, "the value of the Real variable %u is not finite.", reference);
}

static int forbids(Model *m, unsigned reference, const void *set) {
    const int is_odd = set && reference < N_REALS && !isfinite(*(const double *)set);
    if (is_odd && IS(NAN_CRASH)) raise(SIGSEGV);
    return m->discards = is_odd && !IS(NAN_ACCEPTED);
}

/* ---- equations ------------------------------------------------------------------------- */

static double acceleration(const Model *m, double x, double v) {
    const double damping = IS(DISAGREE) && !m->is_model ? 1.2 * C : C;
    const double stop = IS(RELATION) && m->is_model && x > THRESHOLD ? 2.0 : 0.0;
    return m->real[GAIN] * m->real[U] - K * x - damping * v - stop;
}

static void integrate(Model *m, double length) {
    const int count = (int)ceil(length / SUBSTEP - 1e-6);
    const double h = length / count;
    double *x = &m->real[X], *v = &m->real[V];
    for (int k = 0; k < count; k++) {
        const double v1 = *v, a1 = acceleration(m, *x, v1);
        const double v2 = *v + 0.5 * h * a1, a2 = acceleration(m, *x + 0.5 * h * v1, v2);
        const double v3 = *v + 0.5 * h * a2, a3 = acceleration(m, *x + 0.5 * h * v2, v3);
        const double v4 = *v + h * a3, a4 = acceleration(m, *x + h * v3, v4);
        *x += h / 6.0 * (v1 + 2.0 * v2 + 2.0 * v3 + v4);
        *v += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4);
    }
}

static void compute(Model *m) {
    double *r = m->real;
    const int is_stale = IS(STALE) && m->mode == STEP && !m->is_model && m->steps > 0;
    const double x = is_stale ? m->before[0] : r[X], v = is_stale ? m->before[1] : r[V];
    r[POSITION] = !m->poison ? x : IS(NAN_LATER) ? NAN : INFINITY;
    r[SPEED] = v;
    r[ACCELERATION] = acceleration(m, x, v);
    r[TOTAL] = x + 0.5 * r[W] + (IS(RANGE) ? 50.0 : 0.0);
    if (IS(NAN_INITIAL) && m->mode == INITIALIZATION) r[POSITION] = NAN;
    if (IS(NOT_FINAL) && m->mode == TERMINATED) r[POSITION] = 0.0;
    if (IS(INDIRECT) && m->mode == STEP && !m->is_model && m->steps > 0) r[TOTAL] = x + 0.5 * m->before[3];
    r[TIME] = is_stale ? m->before[2] : m->time;
    r[DER_X] = r[V];
    r[DER_V] = acceleration(m, r[X], r[V]);
    if (m->mode == INITIALIZATION) m->moving = r[X] > THRESHOLD;
}

/* ---- instances and values -------------------------------------------------------------- */

static void read_fault(const char *location) {
    char path[1024];
    const char *folder = strncmp(location, "file://", 7) == 0 ? location + 7 : location;
    snprintf(path, sizeof path, "%s/fault.txt", folder);
    FILE *file = fopen(path, "r");
    if (file == NULL) return;
    if (fscanf(file, "%31s", fault) != 1) fault[0] = 0;
    fclose(file);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    static int made;
    read_fault(resources);
    if (IS(ENVIRONMENT) && functions->componentEnvironment == NULL) raise(SIGSEGV);
    const int is_refused = IS(OTHER_GUID) || (IS(ONLY_ONCE) && made++ > 0);
    guid = is_refused ? "{other}" : IS(ANY_GUID) ? MODEL_GUID : guid;
    Model *m = toy_instantiate(name, fmi2CoSimulation, guid, resources, functions, visible, logging);
    if (m == NULL) return NULL;
    m->events = m->is_model = type == fmi2ModelExchange;
    for (int k = 0; k < N_CATEGORIES; k++) m->shown[k] = 1;
    if (IS(LEAK)) memset(taken = malloc(1 << 16), 1, 1 << 16);
    return m;
}

fmi2Status fmi2SetDebugLogging(fmi2Component i, fmi2Boolean on, size_t n, const fmi2String names[]) {
    Model *m = i;
    for (int k = 0; k < N_CATEGORIES; k++) {
        m->shown[k] = n == 0;
        for (size_t j = 0; j < n; j++) m->shown[k] |= strcmp(names[j], CATEGORIES[k]) == 0;
    }
    return toy_set_logging(i, on, n, names);
}

static void freed(Model *m) {
    if (IS(FREE_CRASH)) raise(SIGSEGV);
}

static void share(const Model *m) { memcpy(shared, m->real + X, sizeof shared); }

static void start(Model *m) {
    m->real[GAIN] = 2.0;
    m->real[X] = 0.01;
    m->terminates = 0;
    share(m);
}

static int reset(Model *m) {
    const double v = m->real[V];
    restart(m);
    if (IS(RESET)) m->real[V] = v;
    return OK;
}

static int exit_initialization(Model *m) {
    if (IS(INITIALIZATION_ERROR) && !m->is_model) return REFUSE(m, "there are no consistent values.");
    if (IS(NOT_RESET_BY_ANYONE)) m->real[V] += 0.01 * kept;
    m->moving = m->real[X] > THRESHOLD;
    return tell(m, OK, "initialized at t = %g s", m->time);
}

static void changed(Model *m, unsigned reference) {
    m->last_set = (int)reference;
    share(m);
}

/* ---- states ---------------------------------------------------------------------------- */

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    Model *m = c;
    const double x = m->real[X];
    const fmi2Status status = toy_set_state(c, state);
    if (IS(NOT_RESTORED)) m->real[X] = x;
    share(m);
    return status;
}

static unsigned sum(const char *state) {
    unsigned hash = 2166136261U;
    for (size_t k = 0; k < KEPT_SIZE; k++) hash = (hash ^ (unsigned char)state[k]) * 16777619U;
    return hash;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    *size = IS(STATE_SIZE) ? (size_t)1 << 60 : IS(STATE_EMPTY) ? 0 : sizeof(Bytes);
    return fmi2OK;
}

static fmi2Status serialize(Model *m, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    Bytes whole = {.magic = MAGIC, .place = IS(STATE_ADDRESS) ? shared : NULL};
    if (size < sizeof whole) return REFUSE(m, "there is no room for a state.");
    memcpy(whole.state, state, KEPT_SIZE);
    if (IS(NOT_SERIALIZED)) memset(whole.state + offsetof(Model, real[V]), 0, sizeof(double));
    whole.check = sum(whole.state);
    memcpy(bytes, &whole, sizeof whole);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    Bytes whole;
    if (size != sizeof whole) return REFUSE((Model *)c, "%u bytes are no state.", (unsigned)size);
    memcpy(&whole, bytes, sizeof whole);
    if (IS(STATE_ADDRESS)) scratch = *whole.place;
    if (whole.magic == MAGIC && whole.check == sum(whole.state)) return (Status)copy_state(whole.state, state);
    if (IS(DAMAGED_CRASH)) raise(SIGSEGV);
    return REFUSE((Model *)c, "these bytes are no state.");
}

#ifndef FAULT
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (IS(STATE_NOT_REUSED)) *state = NULL;
    return toy_get_state(c, state);
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return serialize(c, state, bytes, size);
}
#endif

/* ---- derivatives ----------------------------------------------------------------------- */

/* What a fault makes of a derivative; `k` and `j` are the positions of the unknown and the known. */
static double spoil(const Model *m, size_t k, size_t j, unsigned known) {
    if (IS(DERIVATIVE_FIRST) && k > 0) return 0.0;
    if (IS(DERIVATIVE_SECOND) && j > 0) return 2.0;
    if (IS(DERIVATIVE_STATE) && (known == X || known == V)) return -1.0;
    if (IS(DERIVATIVE_LATER) && m->time > LATER) return 1.1;
    return 1.0;
}

static double partial(const Model *m, unsigned unknown, unsigned known) {
    const double by_u = (IS(DERIVATIVE) ? 1.05 : 1.0) * m->real[GAIN];
    if (unknown == ACCELERATION || unknown == DER_V)
        return known == U ? by_u : known == X ? -K : known == V ? -C : known == GAIN ? m->real[U] : 0.0;
    if (unknown == TOTAL) return known == W ? 0.5 : known == X ? 1.0 : 0.0;
    if (unknown == POSITION) return known == X;
    return (unknown == SPEED || unknown == DER_X) && known == V;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component i, const fmi2ValueReference unknowns[], size_t nu,
                                        const fmi2ValueReference knowns[], size_t nk, const fmi2Real seed[],
                                        fmi2Real value[]) {
    ENTER(INITIALIZATION | EVENT | STEP);
    if (IS(DERIVATIVE_CRASH)) raise(SIGSEGV);
    for (size_t k = 0; k < nu; k++) {
        value[k] = 0.0;
        for (size_t j = 0; j < nk; j++) value[k] += spoil(m, k, j, knowns[j]) * partial(m, unknowns[k], knowns[j]) * seed[j];
    }
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component i, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[]) {
    ENTER(ANY_MODE);
    const int is_late = IS(OUTPUT_DERIVATIVE_LATE);
    const double v = is_late ? m->before[1] : m->real[V], a = acceleration(m, is_late ? m->before[0] : m->real[X], v);
    for (size_t k = 0; k < n; k++) {
        value[k] = order[k] > 1 ? 0.0 : r[k] == SPEED ? a : r[k] == ACCELERATION ? -K * v - C * a : v;
        if (IS(OUTPUT_DERIVATIVE)) value[k] = 2.0 * value[k] + 10.0;
    }
    return fmi2OK;
}

/* ---- co-simulation --------------------------------------------------------------------- */

typedef double Reading(const volatile double *block, double before);

/* Allocates blocks, reads what `reading` says of each, and frees them. One block could be the same in all runs: the C
 * library returns the last one that anybody freed. It cannot have so many of a size at hand. */
static double use_memory(Reading *reading) {
    void *volatile blocks[BLOCKS];
    double found = 0.0;
    for (int k = 0; k < BLOCKS; k++) blocks[k] = malloc(40);
    for (int k = 0; k < BLOCKS; k++) found = reading(blocks[k], found);
    for (int k = 0; k < BLOCKS; k++) free(blocks[k]);
    return found;
}

/* A number from 0 to 1 that is another one for each sequence of addresses. */
static double hash_address(const volatile double *block, double before) {
    return fmod(before * 1021.0 + (double)((uintptr_t)block % 65521U) / 65521.0, 1.0);
}

static double add_content(const volatile double *block, double before) {
    const double content = block[3]; /* the C library has pointers at the start of what is free */
    return fabs(content) < 100.0 ? before + content : before;
}

/* What a step does that it should not. */
static int misbehave(Model *m) {
    double *v = &m->real[V];
    struct timespec now;
    if (IS(SEGFAULT)) raise(SIGSEGV);
    if (IS(EXIT)) exit(0);
    if (IS(ABORT)) abort();
    while (IS(HANG)) spins++;
    if (IS(NAN_LATER) || IS(INFINITE_LATER)) m->poison = 1;
    if (IS(NEGATIVE_STATUS)) return -1;
    if (IS(PENDING)) return PENDING;
    if (IS(ASKS_TO_END)) {
        m->terminates = 1;
        return tell(m, DISCARDED, "it is over at t = %g s.", m->time);
    }
    if (IS(CLOCK)) {
        clock_gettime(CLOCK_REALTIME, &now);
        *v += 1e-6 * ((double)now.tv_nsec / 1e9);
    }
    if (IS(SECONDS)) *v += 1e-8 * (double)(time(NULL) % 101);
    if (IS(ADDRESS)) *v += 1e-3 * use_memory(hash_address);
    if (IS(UNINITIALIZED)) *v += 1e-6 * use_memory(add_content);
    if (IS(MEMORY)) {
        if ((taken = malloc(1 << 24)) == NULL) return REFUSE(m, "out of memory.");
        memset(taken, 1, 1 << 24);
    }
    if (IS(NOT_RESET_BY_ANYONE)) kept = 1.0;
    return OK;
}

static int step(Model *m, double time, double length, Step *reached) {
    double *v = &m->real[V];
    if (!(length > 0.0) || fabs(time - m->time) > 1e-6 * length)
        return REFUSE(m, "a step from t = %g s by %g s is none.", time, length);
    if (IS(SPLIT_REFUSED) && length < 0.0099) return REFUSE(m, "the step size is 0.01 s.");
    if (IS(PRINTS)) printf("a step to t = %g s\n", time + length);
    if (IS(SLOW)) usleep(50000);
    if (IS(THREADS)) {
        scratch = *v;
        for (int k = 0; k < 50 && scratch == *v; k++) usleep(20); /* until another thread writes there */
        *v = scratch;
    }
    if (IS(ORDER) && m->last_set == U) *v += 1e-3;
    if (IS(STEP_SIZE) && length < 0.0099) *v *= 1.01;
    const int status = time + length > LATER ? misbehave(m) : OK;
    if (status != OK) return status;
    m->before[0] = m->real[X];
    m->before[1] = *v;
    m->before[2] = m->time;
    m->before[3] = m->real[W];
    integrate(m, IS(STEP_IGNORED) ? 0.01 : length);
    m->time = time + length;
    m->steps++;
    m->moving = m->real[X] > THRESHOLD;
    share(m);
    return tell(m, OK, "a step to t = %g s", m->time);
}

static int get_status(Model *m, int kind, void *value) {
    if (kind == fmi2LastSuccessfulTime) *(double *)value = m->time;
    if (kind == fmi2Terminated) *(int *)value = m->terminates;
    return kind == fmi2LastSuccessfulTime || kind == fmi2Terminated ? OK : DISCARDED;
}

/* ---- model exchange -------------------------------------------------------------------- */

static int update(Model *m, Update *u) {
    u->again = IS(ENDLESS) || (IS(ENDLESS_LATER) && m->time > LATER);
    if (IS(JUMP) && m->moving != (m->real[X] > THRESHOLD)) m->real[V] *= 0.9;
    if (IS(EVENT_KICK)) m->real[V] += 1e-3, u->values_changed = 1;
    m->moving = m->real[X] > THRESHOLD;
    return OK;
}

static void derivatives(Model *m, double dx[]) {
    compute(m);
    memcpy(dx, m->real + DER_X, 2 * sizeof *dx);
    if (IS(DERIVATIVES_SWAPPED)) dx[0] = m->real[DER_V], dx[1] = m->real[DER_X];
}

static void get_indicators(Model *m, double z[]) {
    z[0] = m->real[X] - THRESHOLD;
    if (IS(TWO_INDICATORS)) z[1] = 1.0;
}

static const Toy toy = {
    MODEL(variables), .state_size = KEPT_SIZE, .before = before, .wrong_mode = wrong_mode, .refused = refused,
    .forbids = forbids, .compute = compute, .freed = freed, .start = start, .reset = reset,
    .exit_initialization = exit_initialization, .changed = changed, .step = step, .status = get_status,
    .update = update, .states = 2, .indicators = 1, .state_offset = offsetof(Model, real[X]),
    .derivatives = derivatives, .get_indicators = get_indicators,
};
