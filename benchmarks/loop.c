/* Jacobi as a plain C program: the practical limit for any tool, and the time of the FMUs' own calls.
 *
 *     loop PLAN STEPS EVERY [replay]
 *
 * All inputs are set, all FMUs step, all outputs are read; all signals are recorded to memory at
 * every EVERYth step. With `replay` this is not timed: it notes the inputs of some steps, then other
 * instances of the FMUs get these inputs again, with nothing else done between the calls, and so on.
 *
 * The plan is one statement per line; what follows a component belongs to it:
 *
 *     time STEP STOP CLOCK                           in s; what CLOCK may be says fill_points
 *     component NAME GUID RESOURCES LIBRARY          the library's path goes to the end of the line
 *     real | integer | boolean REFERENCE VALUE       a start value
 *     input REFERENCE SIGNAL                         signals are all outputs, numbered in their order
 *     output REFERENCE
 *
 * It prints the seconds that the steps took, then all signals after the last one.
 * The exit code is 0, or 1 with a message on stderr.
 */
#define _POSIX_C_SOURCE 200809L /* getline, clock_gettime, dlopen */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmu.h"

#define LIMIT 64    /* of components, and of variables of one component */
#define PORTION 100 /* steps whose inputs are noted at a time: they fit into the processor's cache */

typedef struct {
    char type;
    fmi2ValueReference reference;
    double value;
} StartValue;

typedef struct {
    char name[128], guid[128], resources[4096], path[4096];
    Fmu fmu;
    fmi2Component instance;
    StartValue start_values[LIMIT];
    fmi2ValueReference inputs[LIMIT], outputs[LIMIT];
    size_t sources[LIMIT];            /* of its inputs, as positions in the signals */
    size_t first_input, first_signal; /* where its parts of all inputs and of all signals begin */
    size_t n_start_values, n_inputs, n_outputs;
} Component;

typedef struct {
    double step, stop;
    char clock[16];
    Component components[LIMIT];
    size_t n_components, n_inputs, n_signals;
} Plan;

static void fail(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fputs("loop: ", stderr);
    vfprintf(stderr, format, arguments);
    fputs(".\n", stderr);
    va_end(arguments);
    exit(1);
}

static inline void check(fmi2Status status, const Component *component, const char *call) {
    if (status > fmi2Warning) fail("%s answered %s with %s", component->name, call, status_name(status));
}

static void log_message(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    (void)environment;
    fprintf(stderr, "[%s] %s, %s: %s\n", instance, status_name(status), category, message);
}

static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};

/* Memory that the system has handed out already, so that no step waits for it. */
static void *allocate(size_t count, size_t size) {
    void *memory = malloc(count * size + 1);
    if (memory == NULL) fail("out of memory");
    return memset(memory, 1, count * size + 1);
}

/* ---- the plan -------------------------------------------------------------------------- */

static int read_component(Plan *plan, const char *line) {
    if (plan->n_components == LIMIT) return 0;
    Component *c = &plan->components[plan->n_components++];
    c->first_input = plan->n_inputs;
    c->first_signal = plan->n_signals;
    if (sscanf(line, "%*s %127s %127s %4095s %4095[^\n]", c->name, c->guid, c->resources, c->path) != 4)
        return 0;
    const char *problem = load_fmu(&c->fmu, c->path);
    if (problem != NULL) fail("%s", problem);
    return 1;
}

static int read_statement(Plan *plan, const char *line) {
    char word[16];
    if (sscanf(line, "%15s", word) != 1) return 0;
    if (strcmp(word, "time") == 0)
        return sscanf(line, "%*s %lf %lf %15s", &plan->step, &plan->stop, plan->clock) == 3;
    if (strcmp(word, "component") == 0) return read_component(plan, line);
    if (plan->n_components == 0) return 0;
    Component *c = &plan->components[plan->n_components - 1];
    if (strcmp(word, "input") == 0 && c->n_inputs < LIMIT) {
        const size_t i = c->n_inputs++;
        plan->n_inputs++;
        return sscanf(line, "%*s %u %zu", &c->inputs[i], &c->sources[i]) == 2;
    }
    if (strcmp(word, "output") == 0 && c->n_outputs < LIMIT) {
        plan->n_signals++;
        return sscanf(line, "%*s %u", &c->outputs[c->n_outputs++]) == 1;
    }
    if (c->n_start_values == LIMIT) return 0;
    StartValue *s = &c->start_values[c->n_start_values++];
    s->type = word[0];
    return sscanf(line, "%*s %u %lf", &s->reference, &s->value) == 2;
}

static Plan *read_plan(const char *path) {
    Plan *plan = calloc(1, sizeof *plan);
    FILE *file = fopen(path, "r");
    char *line = NULL;
    size_t room = 0;
    if (plan == NULL) fail("out of memory");
    if (file == NULL) fail("cannot read the plan %s", path);
    while (getline(&line, &room, file) >= 0)
        if (!read_statement(plan, line)) fail("the plan has a line that cannot be used: %s", line);
    free(line);
    fclose(file);
    for (size_t i = 0; i < plan->n_components; i++)
        for (size_t j = 0; j < plan->components[i].n_inputs; j++)
            if (plan->components[i].sources[j] >= plan->n_signals)
                fail("%s reads a signal that is not there", plan->components[i].name);
    return plan;
}

/* ---- the calls ------------------------------------------------------------------------- */

#define EACH(plan, c) for (Component *c = (plan)->components, *end = c + (plan)->n_components; c < end; c++)

static inline void set_inputs(const Component *c, const double *inputs) {
    if (c->n_inputs > 0)
        check(c->fmu.SetReal(c->instance, c->inputs, c->n_inputs, inputs + c->first_input), c, "fmi2SetReal");
}

static inline void get_outputs(const Component *c, double *signals) {
    check(c->fmu.GetReal(c->instance, c->outputs, c->n_outputs, signals + c->first_signal), c, "fmi2GetReal");
}

static inline void do_step(const Component *c, double time, double step) {
    check(c->fmu.DoStep(c->instance, time, step, fmi2True), c, "fmi2DoStep");
}

static inline void gather(const Component *c, const double *signals, double *inputs) {
    for (size_t i = 0; i < c->n_inputs; i++) inputs[c->first_input + i] = signals[c->sources[i]];
}

static void set_start_value(const Component *c, const StartValue *s) {
    const fmi2Integer whole = (fmi2Integer)s->value;
    if (s->type == 'r')
        check(c->fmu.SetReal(c->instance, &s->reference, 1, &s->value), c, "fmi2SetReal");
    else if (s->type == 'i')
        check(c->fmu.SetInteger(c->instance, &s->reference, 1, &whole), c, "fmi2SetInteger");
    else
        check(c->fmu.SetBoolean(c->instance, &s->reference, 1, &whole), c, "fmi2SetBoolean");
}

/* New instances of all FMUs, initialized; the signals are their initial outputs. */
static void begin(Plan *plan, double *inputs, double *signals, double *before) {
    const size_t size = plan->n_signals * sizeof *signals;
    EACH(plan, c) {
        c->instance = c->fmu.Instantiate(c->name, fmi2CoSimulation, c->guid, c->resources, &callbacks,
                                         fmi2False, fmi2False);
        if (c->instance == NULL) fail("%s cannot be instantiated", c->name);
        for (size_t i = 0; i < c->n_start_values; i++) set_start_value(c, &c->start_values[i]);
        check(c->fmu.SetupExperiment(c->instance, fmi2False, 0.0, 0.0, fmi2True, plan->stop), c,
              "fmi2SetupExperiment");
        check(c->fmu.EnterInitializationMode(c->instance), c, "fmi2EnterInitializationMode");
    }
    memset(signals, 0, size);
    size_t rounds = plan->n_components + 20;
    do {
        if (rounds-- == 0) fail("the initial values do not settle");
        memcpy(before, signals, size);
        EACH(plan, c) {
            gather(c, signals, inputs);
            set_inputs(c, inputs);
        }
        EACH(plan, c) get_outputs(c, signals);
    } while (memcmp(before, signals, size) != 0);
    EACH(plan, c) check(c->fmu.ExitInitializationMode(c->instance), c, "fmi2ExitInitializationMode");
    EACH(plan, c) get_outputs(c, signals);
}

static void finish(Plan *plan) {
    EACH(plan, c) {
        check(c->fmu.Terminate(c->instance), c, "fmi2Terminate");
        c->fmu.FreeInstance(c->instance);
    }
}

/* ---- the loops ------------------------------------------------------------------------- */

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* What an FMU is told of a step, in s. */
typedef struct {
    double time, step;
} Point;

/* Tools differ in the last bits of these: the doubles nearest to the decimal times, here by whole
 * nanoseconds, and their differences; products with the step; or sums of it. */
static void fill_points(const Plan *plan, Point *points, long steps) {
    const long nanoseconds = (long)(plan->step * 1e9 + 0.5);
    double sum = 0.0;
    for (long k = 0; k < steps; k++) {
        points[k] = (Point){(double)(k * nanoseconds) / 1e9, plan->step};
        if (strcmp(plan->clock, "products") == 0)
            points[k].time = (double)k * plan->step;
        else if (strcmp(plan->clock, "sums") == 0)
            points[k].time = sum;
        else
            points[k].step = (double)((k + 1) * nanoseconds) / 1e9 - points[k].time;
        sum += plan->step;
    }
}

/* Step to the end; the inputs of a step begin `stride` values after those of the step before. */
static double run(Plan *plan, const Point *points, long steps, long every, double *inputs, size_t stride,
                  double *signals, double *rows) {
    const size_t size = plan->n_signals * sizeof *signals;
    const double started = now();
    for (long k = 0; k < steps; k++, inputs += stride) {
        EACH(plan, c) {
            gather(c, signals, inputs);
            set_inputs(c, inputs);
        }
        EACH(plan, c) do_step(c, points[k].time, points[k].step);
        EACH(plan, c) get_outputs(c, signals);
        if ((k + 1) % every == 0) memcpy(rows + (size_t)(k / every) * plan->n_signals, signals, size);
    }
    return now() - started;
}

static double replay(Plan *plan, const Point *points, long steps, const double *inputs, double *signals) {
    const double started = now();
    for (long k = 0; k < steps; k++, inputs += plan->n_inputs) {
        EACH(plan, c) set_inputs(c, inputs);
        EACH(plan, c) do_step(c, points[k].time, points[k].step);
        EACH(plan, c) get_outputs(c, signals);
    }
    return now() - started;
}

/* Step to the end; the seconds that the calls alone take to do the same. */
static double run_and_replay(Plan *plan, Plan *other, const Point *points, long steps, double *signals,
                             double *before) {
    const size_t size = plan->n_signals * sizeof *signals;
    double *inputs = allocate(plan->n_inputs * PORTION, sizeof *inputs);
    double *replayed = allocate(plan->n_signals, sizeof *replayed);
    double seconds = 0.0;
    begin(other, inputs, replayed, before);
    for (long k = 0; k < steps; k += PORTION) {
        const long count = steps - k < PORTION ? steps - k : PORTION;
        run(plan, points + k, count, PORTION + 1, inputs, plan->n_inputs, signals, NULL);
        seconds += replay(other, points + k, count, inputs, replayed);
        if (memcmp(signals, replayed, size) != 0) fail("the replay differs from the run");
    }
    finish(other);
    free(replayed);
    free(inputs);
    return seconds;
}

int main(int count, char **arguments) {
    if (count < 4 || count > 5) fail("usage: loop PLAN STEPS EVERY [replay]");
    Plan *plan = read_plan(arguments[1]), *other = read_plan(arguments[1]);
    const long steps = atol(arguments[2]), every = atol(arguments[3]);
    const int replays = count == 5 && strcmp(arguments[4], "replay") == 0;
    if (steps < 0 || every < 1) fail("STEPS and EVERY must be positive");
    Point *points = allocate((size_t)steps, sizeof *points);
    fill_points(plan, points, steps);
    double *inputs = allocate(plan->n_inputs, sizeof *inputs);
    double *signals = allocate(plan->n_signals, sizeof *signals);
    double *before = allocate(plan->n_signals, sizeof *before);
    double *rows = allocate((size_t)(steps / every) * plan->n_signals, sizeof *rows);
    begin(plan, inputs, signals, before);
    const double seconds = replays ? run_and_replay(plan, other, points, steps, signals, before)
                                   : run(plan, points, steps, every, inputs, 0, signals, rows);
    finish(plan);
    printf("%a\n", seconds);
    for (size_t i = 0; i < plan->n_signals; i++) printf("%a\n", signals[i]);
    free(rows);
    free(before);
    free(signals);
    free(inputs);
    free(points);
    free(other);
    free(plan);
    return 0;
}
