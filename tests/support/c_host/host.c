/* A host for FMI 2.0 co-simulation: reads a plan, runs its components as Jacobi, writes their outputs.
 *
 *     host [-c CYCLES] [-t THREADS] [-m MAPS] PLAN RESULTS
 *
 * The plan is one statement per line; components are numbered from 0 in their order:
 *
 *     time FIRST PER_STEP DENOMINATOR STEPS          point k is (FIRST + k PER_STEP) / DENOMINATOR, in s
 *     component NAME GUID RESOURCES LIBRARY          the library's path goes to the end of the line
 *     real | integer | boolean COMPONENT VR VALUE    a start value
 *     connect SOURCE VR TARGET VR
 *     print COMPONENT VR
 *
 * RESULTS gets one line per communication point: the values to print as hexadecimal floats.
 * Every thread instantiates, runs and frees all components CYCLES times, one run after the
 * other, and every run must give the bits of the first. MAPS gets what is mapped into the process.
 * The exit code is 0, or 1 with a message on stderr, also for any status above fmi2Warning.
 */
#define _POSIX_C_SOURCE 200809L /* getopt, threads, dlopen */
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "fmu.h"

#define LIMIT 256 /* of components, connections, start values and printed values each */

typedef struct {
    char name[128], guid[128], resources[4096], path[4096];
    const Fmu *fmu;
} Component;

typedef struct {
    char type;
    size_t component;
    fmi2ValueReference reference;
    double value;
} StartValue;

typedef struct {
    size_t component;
    fmi2ValueReference reference;
} Variable;

typedef struct {
    Variable source, target;
} Connection;

typedef struct {
    double first, per_step, denominator;
    long steps;
    Component components[LIMIT];
    Fmu fmus[LIMIT];
    StartValue start_values[LIMIT * 16];
    Connection connections[LIMIT];
    Variable printed[LIMIT];
    size_t n_components, n_start_values, n_connections, n_printed;
} Plan;

/* One thread's work: its rows are the first run's, a row of printed values per communication point. */
typedef struct {
    const Plan *plan;
    long cycles;
    double *rows;
} Job;

static void fail(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    fputs("host: ", stderr);
    vfprintf(stderr, format, arguments);
    fputs(".\n", stderr);
    va_end(arguments);
    _Exit(1); /* other threads still run; what they hold is no leak */
}

static void check(fmi2Status status, const Component *component, const char *call) {
    if (status > fmi2Warning) fail("%s answered %s with %s", component->name, call, status_name(status));
}

static void log_message(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    va_list arguments;
    (void)environment;
    va_start(arguments, message);
    fprintf(stderr, "[%s] %s, %s: ", instance, status_name(status), category);
    vfprintf(stderr, message, arguments);
    fputc('\n', stderr);
    va_end(arguments);
}

static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};

static void *allocate(size_t count, size_t size) {
    void *memory = calloc(count > 0 ? count : 1, size);
    if (memory == NULL) fail("out of memory");
    return memory;
}

/* ---- the plan -------------------------------------------------------------------------- */

/* The library of a component: loaded once, however many components use it. */
static const Fmu *library_of(Plan *plan, size_t component) {
    for (size_t i = 0; i < component; i++)
        if (strcmp(plan->components[i].path, plan->components[component].path) == 0)
            return plan->components[i].fmu;
    const char *problem = load_fmu(&plan->fmus[component], plan->components[component].path);
    if (problem != NULL) fail("%s", problem);
    return &plan->fmus[component];
}

static int read_statement(Plan *plan, const char *line) {
    char word[16];
    if (sscanf(line, "%15s", word) != 1) return 0;
    if (strcmp(word, "time") == 0)
        return sscanf(line, "%*s %lf %lf %lf %ld", &plan->first, &plan->per_step, &plan->denominator,
                      &plan->steps) == 4;
    if (strcmp(word, "component") == 0 && plan->n_components < LIMIT) {
        Component *c = &plan->components[plan->n_components];
        if (sscanf(line, "%*s %127s %127s %4095s %4095[^\n]", c->name, c->guid, c->resources, c->path) != 4)
            return 0;
        c->fmu = library_of(plan, plan->n_components++);
        return 1;
    }
    if (strcmp(word, "connect") == 0 && plan->n_connections < LIMIT) {
        Connection *c = &plan->connections[plan->n_connections++];
        return sscanf(line, "%*s %zu %u %zu %u", &c->source.component, &c->source.reference,
                      &c->target.component, &c->target.reference) == 4 &&
               c->source.component < plan->n_components && c->target.component < plan->n_components;
    }
    if (strcmp(word, "print") == 0 && plan->n_printed < LIMIT) {
        Variable *v = &plan->printed[plan->n_printed++];
        return sscanf(line, "%*s %zu %u", &v->component, &v->reference) == 2 &&
               v->component < plan->n_components;
    }
    if (strchr("rib", word[0]) != NULL && plan->n_start_values < LIMIT * 16) {
        StartValue *s = &plan->start_values[plan->n_start_values++];
        s->type = word[0];
        return sscanf(line, "%*s %zu %u %lf", &s->component, &s->reference, &s->value) == 3 &&
               s->component < plan->n_components;
    }
    return 0;
}

static Plan *read_plan(const char *path) {
    Plan *plan = allocate(1, sizeof *plan);
    FILE *file = fopen(path, "r");
    static char line[10000];
    if (file == NULL) fail("cannot read the plan %s", path);
    while (fgets(line, sizeof line, file) != NULL)
        if (!read_statement(plan, line)) fail("the plan has a line that cannot be used: %s", line);
    fclose(file);
    return plan;
}

/* ---- one run --------------------------------------------------------------------------- */

static double get(const Plan *plan, fmi2Component *instances, const Variable *v) {
    const Component *component = &plan->components[v->component];
    double value = 0.0;
    check(component->fmu->GetReal(instances[v->component], &v->reference, 1, &value), component,
          "fmi2GetReal");
    return value;
}

static void set(const Plan *plan, fmi2Component *instances, const Variable *v, double value) {
    const Component *component = &plan->components[v->component];
    check(component->fmu->SetReal(instances[v->component], &v->reference, 1, &value), component,
          "fmi2SetReal");
}

static void pass_values(const Plan *plan, fmi2Component *instances, const double *signals) {
    for (size_t i = 0; i < plan->n_connections; i++)
        set(plan, instances, &plan->connections[i].target, signals[i]);
}

/* Read the connected outputs; whether any of them is another than before, bit for bit. */
static int read_signals(const Plan *plan, fmi2Component *instances, double *signals) {
    int changed = 0;
    for (size_t i = 0; i < plan->n_connections; i++) {
        const double value = get(plan, instances, &plan->connections[i].source);
        changed |= memcmp(&value, &signals[i], sizeof value) != 0;
        signals[i] = value;
    }
    return changed;
}

static void set_start_values(const Plan *plan, fmi2Component *instances) {
    for (size_t i = 0; i < plan->n_start_values; i++) {
        const StartValue *s = &plan->start_values[i];
        const Component *component = &plan->components[s->component];
        const fmi2Integer whole = (fmi2Integer)s->value;
        fmi2Component instance = instances[s->component];
        if (s->type == 'r')
            check(component->fmu->SetReal(instance, &s->reference, 1, &s->value), component, "fmi2SetReal");
        else if (s->type == 'i')
            check(component->fmu->SetInteger(instance, &s->reference, 1, &whole), component,
                  "fmi2SetInteger");
        else
            check(component->fmu->SetBoolean(instance, &s->reference, 1, &whole), component,
                  "fmi2SetBoolean");
    }
}

#define EACH(call, ...)                                                                               \
    for (size_t i = 0; i < plan->n_components; i++)                                                   \
    check(plan->components[i].fmu->call(__VA_ARGS__), &plan->components[i], "fmi2" #call)

static double point(const Plan *plan, long k) {
    return (plan->first + (double)k * plan->per_step) / plan->denominator;
}

static void initialize(const Plan *plan, fmi2Component *instances, double *signals) {
    set_start_values(plan, instances);
    EACH(SetupExperiment, instances[i], fmi2False, 0.0, point(plan, 0), fmi2True, point(plan, plan->steps));
    EACH(EnterInitializationMode, instances[i]);
    memset(signals, 0, plan->n_connections * sizeof *signals);
    size_t rounds = plan->n_components + 20;
    do {
        if (rounds-- == 0) fail("the initial values do not settle");
        pass_values(plan, instances, signals);
    } while (read_signals(plan, instances, signals));
    EACH(ExitInitializationMode, instances[i]);
    read_signals(plan, instances, signals);
}

static void write_row(const Plan *plan, fmi2Component *instances, double *row) {
    for (size_t i = 0; i < plan->n_printed; i++) row[i] = get(plan, instances, &plan->printed[i]);
}

/* Instantiate everything, run it and free it. */
static void run(const Plan *plan, double *rows) {
    fmi2Component *instances = allocate(plan->n_components, sizeof *instances);
    double *signals = allocate(plan->n_connections, sizeof *signals);
    for (size_t i = 0; i < plan->n_components; i++) {
        const Component *c = &plan->components[i];
        instances[i] = c->fmu->Instantiate(c->name, fmi2CoSimulation, c->guid, c->resources, &callbacks,
                                           fmi2False, fmi2False);
        if (instances[i] == NULL) fail("%s cannot be instantiated", c->name);
    }
    initialize(plan, instances, signals);
    write_row(plan, instances, rows);
    for (long k = 0; k < plan->steps; k++) {
        const double time = point(plan, k);
        pass_values(plan, instances, signals);
        EACH(DoStep, instances[i], time, point(plan, k + 1) - time, fmi2True);
        read_signals(plan, instances, signals);
        write_row(plan, instances, rows + (size_t)(k + 1) * plan->n_printed);
    }
    EACH(Terminate, instances[i]);
    for (size_t i = 0; i < plan->n_components; i++) plan->components[i].fmu->FreeInstance(instances[i]);
    free(signals);
    free(instances);
}

/* ---- cycles and threads ---------------------------------------------------------------- */

static size_t count_values(const Plan *plan) { return (size_t)(plan->steps + 1) * plan->n_printed; }

static void *run_cycles(void *argument) {
    const Job *job = argument;
    const size_t size = count_values(job->plan) * sizeof *job->rows;
    double *again = allocate(1, size);
    for (long cycle = 1; cycle <= job->cycles; cycle++) {
        run(job->plan, cycle == 1 ? job->rows : again);
        if (cycle > 1 && memcmp(job->rows, again, size) != 0) fail("run %ld differs from the first", cycle);
    }
    free(again);
    return NULL;
}

static void run_threads(const Plan *plan, long threads, long cycles, double *rows) {
    const size_t count = count_values(plan);
    pthread_t *ids = allocate((size_t)threads, sizeof *ids);
    Job *jobs = allocate((size_t)threads, sizeof *jobs);
    for (long i = 0; i < threads; i++) {
        jobs[i] = (Job){plan, cycles, rows + (size_t)i * count};
        if (pthread_create(&ids[i], NULL, run_cycles, &jobs[i]) != 0) fail("cannot start a thread");
    }
    for (long i = 0; i < threads; i++) pthread_join(ids[i], NULL);
    for (long i = 1; i < threads; i++)
        if (memcmp(rows, jobs[i].rows, count * sizeof *rows) != 0) fail("threads differ in their results");
    free(jobs);
    free(ids);
}

/* ---- output ---------------------------------------------------------------------------- */

static FILE *open_for_writing(const char *path) {
    FILE *file = fopen(path, "w");
    if (file == NULL) fail("cannot write %s", path);
    return file;
}

static void write_results(const Plan *plan, const double *rows, const char *path) {
    FILE *file = open_for_writing(path);
    for (long k = 0; k <= plan->steps; k++)
        for (size_t i = 0; i < plan->n_printed; i++)
            fprintf(file, "%a%c", *rows++, i + 1 < plan->n_printed ? ' ' : '\n');
    if (fclose(file) != 0) fail("cannot write %s", path);
}

static void write_maps(const char *path) {
    FILE *maps = fopen("/proc/self/maps", "r"), *file = open_for_writing(path);
    if (maps == NULL) fail("cannot read /proc/self/maps");
    for (int c; (c = fgetc(maps)) != EOF;) fputc(c, file);
    fclose(maps);
    if (fclose(file) != 0) fail("cannot write %s", path);
}

int main(int count, char **arguments) {
    long cycles = 1, threads = 1;
    const char *maps = NULL;
    for (int option; (option = getopt(count, arguments, "c:t:m:")) != -1;) {
        if (option == 'c') cycles = atol(optarg);
        else if (option == 't') threads = atol(optarg);
        else if (option == 'm') maps = optarg;
        else return 1;
    }
    if (count - optind != 2 || cycles < 1 || threads < 1)
        fail("usage: host [-c CYCLES] [-t THREADS] [-m MAPS] PLAN RESULTS");
    Plan *plan = read_plan(arguments[optind]);
    double *rows = allocate((size_t)threads * count_values(plan), sizeof *rows);
    run_threads(plan, threads, cycles, rows);
    write_results(plan, rows, arguments[optind + 1]);
    if (maps != NULL) write_maps(maps);
    free(rows);
    free(plan);
    return 0;
}
