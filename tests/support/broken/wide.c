/* An FMI 2.0 FMU for co-simulation with variables of all types and variabilities, in which any one can be wrong:
 *
 *     x' = k u - d x,          y = x + u / 2 while on, + w,    sum = n + m + p,    count = number of steps,
 *     mode = mode_in,          mode_2 = mode_p,                flag = on and not latch,   flag_2 = enabled,
 *     text = name,             echo = label.
 *
 * resources/fault.txt has the name of a fault, and the value reference of the variable that is wrong. Functions that
 * a fault changes call those of toyfmu.h, which have other names here.
 */
#define _GNU_SOURCE
#include <dlfcn.h>

#include "fmi2Functions.h"

#undef fmi2GetVersion
#undef fmi2GetReal
#undef fmi2GetInteger
#undef fmi2GetBoolean
#undef fmi2GetString
#undef fmi2SetReal
#undef fmi2SetFMUstate
#undef fmi2FreeFMUstate
#undef fmi2SerializeFMUstate
#define fmi2GetVersion toy_version
#define fmi2GetReal toy_get_Real
#define fmi2GetInteger toy_get_Integer
#define fmi2GetBoolean toy_get_Boolean
#define fmi2GetString toy_get_String
#define fmi2SetReal toy_set_reals
#define fmi2SetFMUstate toy_set_state
#define fmi2FreeFMUstate toy_free_state
#define fmi2SerializeFMUstate toy_serialize
#define FMI 2
#include "toyfmu.h"
#undef fmi2SetReal
#undef fmi2GetVersion
#undef fmi2GetReal
#undef fmi2GetInteger
#undef fmi2GetBoolean
#undef fmi2GetString
#undef fmi2SetFMUstate
#undef fmi2FreeFMUstate
#undef fmi2SerializeFMUstate

enum { U, W, K, D, X, DER_X, Y, G, N_REALS, TIME = 8 };
enum { N, M, P, MODE_IN, MODE_P, SUM, MODE, MODE_2, COUNT, C_INTEGER, N_INTEGERS };
enum { ON, LATCH, ENABLED, FLAG, FLAG_2, C_BOOLEAN, N_BOOLEANS };
enum { LABEL, NAME_P, TAG, TEXT, ECHO, C_STRING, N_STRINGS };
enum { REALS = 0, INTEGERS = 100, BOOLEANS = 200, STRINGS = 300 }; /* the first value references */

#define SUBSTEP 1e-3 /* s, of the integration */
#define LONGEST 64   /* characters of a String */

typedef struct {
    double r[N_REALS], slope[2];
    int i[N_INTEGERS], b[N_BOOLEANS];
    char s[N_STRINGS][LONGEST];
} Values;

struct Model {
    COMMON;
    double from;            /* s, by which a fault counts time later */
    Values now, old, older; /* `old` and `older` are those of earlier steps, which some faults use */
};

static const Values STARTS = {
    .r = {[K] = 2.0, [D] = 1.0, [X] = 0.5, [G] = 9.81},
    .i = {[N] = 1, [M] = 3, [P] = 5, [MODE_IN] = 1, [MODE_P] = 1, [C_INTEGER] = 7},
    .b = {[ON] = 1, [C_BOOLEAN] = 1},
    .s = {[LABEL] = "label", [NAME_P] = "block", [TAG] = "tag", [C_STRING] = "always"},
};

#define REAL(name, settable) VARIABLE(REALS + name, FLOAT64, now.r[name], settable)
#define INTEGER(name, settable) VARIABLE(INTEGERS + name, INT32, now.i[name], settable)
#define TRUTH(name, settable) VARIABLE(BOOLEANS + name, BOOLEAN, now.b[name], settable)
#define WORDS(name, settable) VARIABLE(STRINGS + name, STRING, now.s[name], settable)
static const Variable variables[] = {
    REAL(U, INPUT), REAL(W, INPUT), REAL(K, PARAMETER), REAL(D, INPUT), REAL(X, PARAMETER), REAL(DER_X, OUTPUT),
    REAL(Y, OUTPUT), REAL(G, OUTPUT), VARIABLE(TIME, FLOAT64, time, OUTPUT),
    INTEGER(N, INPUT), INTEGER(M, INPUT), INTEGER(P, PARAMETER), INTEGER(MODE_IN, INPUT), INTEGER(MODE_P, INPUT),
    INTEGER(SUM, OUTPUT), INTEGER(MODE, OUTPUT), INTEGER(MODE_2, OUTPUT), INTEGER(COUNT, OUTPUT),
    INTEGER(C_INTEGER, OUTPUT),
    TRUTH(ON, INPUT), TRUTH(LATCH, INPUT), TRUTH(ENABLED, PARAMETER), TRUTH(FLAG, OUTPUT), TRUTH(FLAG_2, OUTPUT),
    TRUTH(C_BOOLEAN, OUTPUT),
    WORDS(LABEL, INPUT), WORDS(NAME_P, INPUT), WORDS(TAG, PARAMETER), WORDS(TEXT, OUTPUT), WORDS(ECHO, OUTPUT),
    WORDS(C_STRING, OUTPUT),
};

static char fault[40], target[8], folder[900];
static Values shared; /* what was set last, in any instance */

static int is(const char *name) { return strcmp(fault, name) == 0; }
static int wrong(const char *name, unsigned reference) { return is(name) && (unsigned)atoi(target) == reference; }

/* The place of a variable. */
static void *find_in(const Values *v, unsigned reference) {
    const unsigned k = reference % 100;
    if (reference >= STRINGS) return (void *)v->s[k];
    if (reference >= BOOLEANS) return (void *)&v->b[k];
    if (reference >= INTEGERS) return (void *)&v->i[k];
    return (void *)&v->r[k];
}

static void copy_one(Values *to, const Values *from, unsigned reference) {
    const size_t size = reference >= STRINGS ? LONGEST : reference >= INTEGERS ? sizeof(int) : sizeof(double);
    memcpy(find_in(to, reference), find_in(from, reference), size);
}

#include "wide_faults.h"

__attribute__((constructor)) static void load(void) {
    char path[1000];
    Dl_info found;
    FILE *file;
    if (!dladdr((void *)load, &found)) return;
    snprintf(folder, sizeof folder, "%s", found.dli_fname);
    for (int k = 0; k < 3; k++) *strrchr(folder, '/') = 0; /* the library, its platform, binaries */
    snprintf(path, sizeof path, "%s/resources/fault.txt", folder);
    if ((file = fopen(path, "r")) == NULL) return;
    if (fscanf(file, "%39s %7s", fault, target) < 1) fault[0] = 0;
    fclose(file);
    misbehave_at("load");
}

__attribute__((destructor)) static void unload(void) { misbehave_at("unload"); }

static int wrong_mode(Model *m, const char *function) { return say(m, ERROR, "%s is not allowed now.", function); }
static int refused(Model *m, const char *function, unsigned reference) {
    return say(m, ERROR, "%s: the variable %u does not exist, or cannot be set now.", function, reference);
}
static int forbids(Model *m, unsigned reference, const void *set) {
    return set && reference < INTEGERS && !isfinite(*(const double *)set);
}

/* ---- equations ------------------------------------------------------------------------- */

/* What is used, which a fault makes another one than what is set. */
static Values used_values(const Model *m) {
    const unsigned reference = (unsigned)atoi(target);
    Values v = m->now;
    if (m->mode == STEP && is("late")) copy_one(&v, &m->old, reference);
    if (m->mode == STEP && is("delayed")) copy_one(&v, &m->older, reference);
    if (is("shared_used")) copy_one(&v, &shared, reference);
    if (is("unused_later") && m->time > 0.5) copy_one(&v, &STARTS, reference);
    return v;
}

static int exit_initialization(Model *m) {
    m->old = m->older = m->now;
    return OK;
}

static int set_up(Model *m, int has_tolerance, double tolerance) {
    m->from = is("start_ignored") ? m->begin : 0.0;
    m->time -= m->from;
    return OK;
}

static void compute(Model *m) {
    const double y = m->now.r[Y];
    Values *n = &m->now, v = used_values(m);
    if (is("unused")) copy_one(&v, &STARTS, (unsigned)atoi(target));
    if (is("unused_all")) {
        v = STARTS;
        v.r[X] = n->r[X];
    }
    n->r[DER_X] = v.r[K] * v.r[U] - v.r[D] * v.r[X];
    n->r[Y] = v.r[X] + (v.b[ON] ? 0.5 * v.r[U] : 0.0) + v.r[W];
    if (is("output_stops") && m->time > 0.5) n->r[Y] = y;
    n->i[SUM] = v.i[N] + v.i[M] + v.i[P];
    n->i[MODE] = v.i[MODE_IN];
    n->i[MODE_2] = v.i[MODE_P];
    n->b[FLAG] = v.b[ON] && !v.b[LATCH];
    n->b[FLAG_2] = v.b[ENABLED];
    memcpy(n->s[TEXT], v.s[NAME_P], LONGEST);
    memcpy(n->s[ECHO], v.s[LABEL], LONGEST);
    hide_dependency(n);
}

/* What is no fault: the state jumps at events within steps. */
static void jump(Values *n, double time, double length) {
    if (floor((time + length) / 0.07 + 1e-9) > floor(time / 0.07 + 1e-9)) n->r[X] += 1.0;
}

static int get_status(Model *m, int kind, void *value) {
    if (kind != fmi2LastSuccessfulTime) return DISCARDED;
    *(double *)value = m->time - (is("successful_off") ? 0.02 : 0.0);
    return OK;
}

static int step(Model *m, double time, double length, Step *reached) {
    Values *n = &m->now;
    const Values v = used_values(m);
    misbehave_at("step");
    if (is("step_nothing")) return OK;
    const double whole = length * (is("step_double") ? 2.0 : 1.0);
    const int steps = (int)ceil(whole / SUBSTEP - 1e-6);
    const double h = whole / steps, used = is("unused_all") ? 0.0 : is("sign") ? -1.0 : 1.0;
    for (int k = 0; k < steps; k++) {
        const double u = used * (v.r[U] + (is("slope_unused") ? 0.0 : n->slope[0] * (k + 0.5) * h));
        const double half = n->r[X] + 0.5 * h * (v.r[K] * u - v.r[D] * n->r[X]);
        if (is("state_stops") && time > 0.5) break;
        n->r[X] += h * (v.r[K] * u - v.r[D] * half);
        if (is("jumps")) jump(n, time + k * h, h);
    }
    if (is("delayed")) {
        m->older = m->old;
        m->old = *n;
    }
    n->slope[0] = n->slope[1] = 0.0;
    n->i[COUNT]++;
    m->time = time + length + (is("time_off") ? 0.005 : 0.0) - m->from;
    return OK;
}

static int set_slope(Model *m, unsigned reference, int order, double value) {
    if (reference > W || order != 1) return ERROR;
    m->now.slope[reference] = value;
    return OK;
}

/* ---- instances and values -------------------------------------------------------------- */

static void start(Model *m) {
    m->now = STARTS;
    if (is("start")) change(&m->now);
    shared = m->now;
}

static void created(Model *m) { misbehave_at("instantiate"); }

static int reset(Model *m) {
    const Values before = m->now;
    restart(m);
    if (is("reset")) copy_one(&m->now, &before, (unsigned)atoi(target));
    return OK;
}

static void changed(Model *m, unsigned reference) {
    misbehave_at("set");
    copy_one(&shared, &m->now, reference);
    if (wrong("not_set", reference)) copy_one(&m->now, &STARTS, reference);
}

static const Toy toy = {
    MODEL(variables), .wrong_mode = wrong_mode, .refused = refused, .forbids = forbids, .compute = compute,
    .step = step, .set_input_derivative = set_slope, .start = start, .created = created, .reset = reset,
    .changed = changed, .set_up = set_up, .exit_initialization = exit_initialization, .status = get_status,
};

const char *fmi2GetVersion(void) { return is("version") ? target : is("version_null") ? NULL : fmi2Version; }

#define GET(Type, value_in_shared)                                                                      \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##Type v[]) {  \
        const fmi2Status status = toy_get_##Type(c, r, n, v);                                           \
        misbehave_at("get");                                                                            \
        for (size_t k = 0; k < n && !status; k++) {                                                     \
            if (wrong("shared", r[k])) v[k] = value_in_shared(find_in(&shared, r[k]));                  \
            misbehave_with_value(r[k], &v[k], ((Model *)c)->time);                                      \
        }                                                                                               \
        return status;                                                                                  \
    }
GET(Real, *(double *))
GET(Integer, *(int *))
GET(Boolean, *(int *))
GET(String, (char *))

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
    if (is("set_null_crash")) (void)*(const volatile fmi2ValueReference *)r;
    if (is("set_none_crash") && n - 1 == SIZE_MAX) raise(SIGSEGV); /* as a loop down to the last one */
    return is("set_none_error") && n == 0 ? fmi2Error : toy_set_reals(c, r, n, v);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    Model *m = c;
    const Values before = m->now;
    const fmi2Status status = toy_set_state(c, state);
    if (is("state")) copy_one(&m->now, &before, (unsigned)atoi(target));
    return status;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    const fmi2FMUstate before = *state;
    misbehave_at("state");
    if (before == NULL && is("state_null_crash")) abort();
    const fmi2Status status = toy_free_state(c, state);
    if (is("state_kept")) *state = before;
    return status;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    Model copied = *(Model *)state;
    if (is("bytes")) copy_one(&copied.now, &STARTS, (unsigned)atoi(target));
    return toy_serialize(c, &copied, bytes, size);
}
