/* What the fuzzer stands on: its memory of the model, failing with a message that tells how to repeat,
 * random numbers, and calls that are counted and whose messages are checked.
 */
#ifndef FUZZ_HARNESS_H
#define FUZZ_HARNESS_H

#include <float.h>
#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "fmu.h"

#define MAXIMUM_VARIABLES 1024
#define MAXIMUM_CATEGORIES 32
#define INSTANCES 4
#define STATES 6
#define MANY 100000          /* references in a long vector */
#define LONGEST_MESSAGE 4096 /* that an FMU may log */
#define BURST_LIMIT 30       /* s that a burst may take; it takes some 10 ms */
#define REFERENCE_STEPS 20
#define REFERENCE_STEP 1e-3 /* s */
/* A step may have so many internal steps that it is quick, or so many that the FMU has to refuse it. */
#define QUICK_SUBSTEPS 300.0
#define REFUSED_SUBSTEPS 1.001e9

typedef enum { CREATED, INITIALIZING, STEPPING, EVENTS, CONTINUOUS, TERMINATED } Phase;

typedef struct {
    char type, role;
    fmi2ValueReference reference;
    double start, low, high;
} Variable;

typedef struct {
    Fmu fmu;
    char guid[128];
} Library;

/* `phase` is what the calls so far should have led to: it guides the choice of calls, no more. */
typedef struct {
    fmi2Component component;
    fmi2Type type;
    Phase phase;
    char *name;
} Instance;

/* `owner` is the instance that must live as long: the standard does not say that states outlive it. */
typedef struct {
    fmi2FMUstate state;
    const Instance *owner;
    Phase phase;
} Saved;

static Library model, foreign;
static Variable variables[MAXIMUM_VARIABLES];
static char *categories[MAXIMUM_CATEGORIES];
static size_t n_variables, n_categories, n_states, n_indicators, n_outputs;
static fmi2ValueReference outputs[MAXIMUM_VARIABLES]; /* the Real ones */
static long internal_step = -1;

static Instance instances[INSTANCES];
static Saved saved[STATES];
static fmi2Component stranger; /* an instance of the foreign model, and a state of it */
static fmi2FMUstate strange_state;
static uint64_t random_state;
static double wildness; /* how likely an argument is a wrong one in this burst */
static int verbose;
static char repeat[2048] = "fuzz: this was before the first burst.\n"; /* or how to repeat the present one */

/* ---- failing --------------------------------------------------------------------------- */

/* AddressSanitizer calls back before it ends the process; UndefinedBehaviorSanitizer has to abort. */
extern void __sanitizer_set_death_callback(void (*callback)(void)) __attribute__((weak));
const char *__ubsan_default_options(void);
const char *__ubsan_default_options(void) { return "abort_on_error=1"; }

static void say_how_to_repeat(void) {
    if (write(STDERR_FILENO, repeat, strlen(repeat)) < 0) _Exit(4);
}

static void fail(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fputs("fuzz: ", stderr);
    vfprintf(stderr, format, arguments);
    fputs(".\n", stderr);
    va_end(arguments);
    say_how_to_repeat();
    _Exit(1); /* what lives is no leak */
}

static void note_how_to_repeat(const char *program, unsigned long seed, unsigned long burst, long bursts,
                               const char *plan) {
    snprintf(repeat, sizeof repeat, "fuzz: repeat this with: %.900s -s %lu -b %lu -n %ld -v %.900s\n",
             program, seed, burst, bursts, plan);
}

static void take_signal(int number) {
    static const char message[] = "fuzz: a burst does not end.\n";
    if (number == SIGALRM && write(STDERR_FILENO, message, sizeof message - 1) < 0) _Exit(4);
    say_how_to_repeat();
    _Exit(128 + number);
}

static void watch_for_death(void) {
    const struct sigaction action = {.sa_handler = take_signal};
    sigaction(SIGALRM, &action, NULL);
    sigaction(SIGABRT, &action, NULL);
    if (__sanitizer_set_death_callback != NULL) __sanitizer_set_death_callback(say_how_to_repeat);
}

static void *allocate(size_t count, size_t size) {
    if (count == 0) return NULL; /* zero-length vectors are NULL */
    void *memory = malloc(count * size);
    if (memory == NULL) fail("out of memory");
    memset(memory, 0x55, count * size); /* what was not written shows */
    return memory;
}

static char *copied(const char *text) {
    return text == NULL ? NULL : strcpy(allocate(strlen(text) + 1, 1), text);
}

/* ---- random numbers -------------------------------------------------------------------- */

/* xorshift64*: period 2^64 - 1 over states that are not 0 */
static uint64_t random_bits(void) {
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return random_state * UINT64_C(0x2545F4914F6CDD1D);
}

static void seed_random(uint64_t seed, uint64_t burst) {
    random_state = (seed + 1) * UINT64_C(0x9E3779B97F4A7C15) ^ (burst + 1) * UINT64_C(0xD1B54A32D192ED03);
    if (random_state == 0) random_state = 1;
    for (int i = 0; i < 8; i++) random_bits(); /* close seeds start with close numbers */
}

static size_t below(size_t n) { return (size_t)(random_bits() >> 11) % n; }

static double uniform(double low, double high) {
    return low + (high - low) * (double)(random_bits() >> 11) * 0x1p-53;
}

static int happens(double probability) { return uniform(0.0, 1.0) < probability; }

#define ONE_OF(array) ((array)[below(sizeof(array) / sizeof *(array))])

static double any_real(void) {
    static const double special[] = {NAN,    INFINITY, -INFINITY, 0.0,    -0.0,    DBL_MIN, 5e-324, -5e-324,
                                     1e-310, DBL_MAX,  -DBL_MAX,  1e308,  1e150,   -1e150,  1e10,   1e-10,
                                     1e19,   INT_MAX,  INT_MIN,   -1.0,   1.0,     0.5,     1e-3,   1e-16};
    double value;
    const uint64_t bits = random_bits();
    if (happens(0.7)) return ONE_OF(special);
    memcpy(&value, &bits, sizeof value);
    return value;
}

static int any_integer(void) {
    static const int special[] = {INT_MIN, INT_MAX, -1, 0, 1, 2, 3, 255, 65536};
    return happens(0.7) ? ONE_OF(special) : (int)(random_bits() >> 33) - (1 << 30);
}

static fmi2ValueReference any_reference(void) {
    static const fmi2ValueReference special[] = {UINT_MAX, UINT_MAX - 1, INT_MAX, 1u << 31, 1u << 29, 65536};
    if (happens(0.3)) return ONE_OF(special);
    return (fmi2ValueReference)(happens(0.5) ? n_variables + below(3) : below(n_variables));
}

static double sane_value(const Variable *v) {
    double value = v->start;
    if (v->type == 'b') return (double)below(2);
    if (v->type == 'i') return v->high - v->low < 10.0 ? floor(uniform(v->low, v->high + 1.0)) : value;
    if ((long)v->reference == internal_step) return pow(10.0, uniform(-5.0, -2.0));
    if (v->role == 'i' || happens(0.1)) value += uniform(-1.0, 1.0);
    else if (happens(0.5)) value *= uniform(0.5, 2.0);
    return fmin(fmax(value, v->low), v->high);
}

static int offers_model_exchange(void) { return model.fmu.EnterEventMode != NULL; }

/* ---- calls, counted -------------------------------------------------------------------- */

enum {
#define ID(name) ID_##name,
    CO_SIMULATION_FUNCTIONS(ID) MODEL_EXCHANGE_FUNCTIONS(ID) N_FUNCTIONS,
    FIRST_MODEL_EXCHANGE_FUNCTION = ID_EnterEventMode
};
static const char *const function_names[] = {
#define NAME(name) "fmi2" #name,
    CO_SIMULATION_FUNCTIONS(NAME) MODEL_EXCHANGE_FUNCTIONS(NAME)
};
static long counts[N_FUNCTIONS][fmi2Error + 1];

static fmi2Status counted(int function, const Instance *instance, fmi2Status status) {
    /* nothing that an FMU of ours computes with justifies fmi2Fatal, and no step of it is asynchronous */
    if (status < fmi2OK || status > fmi2Error)
        fail("%s answered %s", function_names[function], status_name(status));
    counts[function][status]++;
    if (verbose)
        fprintf(stderr, "  %d %s: %s\n", (int)(instance - instances), function_names[function],
                status_name(status));
    return status;
}

#define CALL(name, instance, ...) \
    counted(ID_##name, instance, model.fmu.name((instance)->component, __VA_ARGS__))
#define CALL_ALONE(name, instance) counted(ID_##name, instance, model.fmu.name((instance)->component))

/* The FMU's messages: well-formed, bounded, without conversions, with the environment and name given. */
static void check_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                          fmi2String category, fmi2String message, ...) {
    const Instance *instance = environment;
    if (name == NULL || category == NULL || message == NULL) fail("the logger was given NULL");
    if (instance < instances || instance >= instances + INSTANCES)
        fail("the logger was given a wrong environment");
    if (instance->name != NULL && *instance->name && strcmp(name, instance->name) != 0)
        fail("the logger was given the instance name '%s'", name);
    if (status < fmi2OK || status > fmi2Error) fail("the logger was given %s", status_name(status));
    size_t known = 0;
    while (known < n_categories && strcmp(category, categories[known]) != 0) known++;
    if (known == n_categories) fail("the log category '%s' is not in the model description", category);
    if (strlen(message) > LONGEST_MESSAGE) fail("a message has %zu characters", strlen(message));
    for (const char *c = message; *c; c++)
        if (*c == '%' && *++c != '%') fail("a message contains a conversion: %s", message);
}

#endif
