/* Calls the FMI 2.0 functions of one model in random orders with random, often wrong arguments.
 *
 *     fuzz [-s SEED] [-b FIRST_BURST] [-n BURSTS | -t SECONDS] [-v] PLAN
 *
 * A burst makes a few hundred calls on up to four instances and then frees everything. Its random
 * numbers depend on the seed and its own number alone, so that it can be repeated alone; -v shows
 * its calls. The plan is one statement per line:
 *
 *     model GUID LIBRARY         the model to call; the path goes to the end of the line
 *     foreign GUID LIBRARY       another one, whose FMU states are given to the first
 *     continuous STATES INDICATORS
 *     internal_step VR           the longest internal step of the integration, a Real parameter
 *     category NAME              of log messages
 *     variable TYPE VR ROLE START LOW HIGH
 *
 * TYPE is r, i or b for Real, Integer and Boolean; ROLE is i for inputs, o for outputs that cannot be
 * set, s for outputs and p for parameters that can be until initialization ends, l for others.
 *
 * What the standard leaves undefined is not done: no dead or NULL instance, no freed state, no
 * array shorter than is said. Violated invariants, crashes, sanitizer reports and calls that do
 * not return end the process with a message that tells how to repeat them. Otherwise the exit
 * code is 0, and stdout has a line per function: how often it was OK, a warning, discarded, an error.
 */
#define _POSIX_C_SOURCE 200809L /* getline, getopt, sigaction, clock_gettime, dlopen */
#include "fuzz_calls.h"
#include "fuzz_harness.h"

/* ---- one burst ------------------------------------------------------------------------- */

typedef void Action(Instance *instance);

static Action *const actions[] = {
    get_Real,        get_Real,         get_Integer,
    get_Boolean,     get_String,       set_Real,
    set_Real,        set_Real,         set_Integer,
    set_Boolean,     set_String,       get_DirectionalDerivative,
    get_DirectionalDerivative,         set_RealInputDerivatives,
    set_RealInputDerivatives,          get_RealOutputDerivatives,
    setup,           enter_initialization,
    exit_initialization,               set_logging,
    do_step,         do_step,          cancel_step,
    get_versions,    get_statuses,     get_state,        get_state,
    get_state,       set_state,        set_state,
    free_state,      serialize_state,  serialize_state,
    deserialize_state,                 deserialize_state,
    deserialize_state,                 get_state_over_a_foreign_one,
};
static Action *const rare_actions[] = {terminate, reset, free_instance};
static Action *const exchange_actions[] = {
    enter_events,    new_discrete_states,     enter_continuous_time, completed_integrator_step,
    set_time,        set_continuous_states,   get_Derivatives,       get_EventIndicators,
    get_ContinuousStates,                     get_NominalsOfContinuousStates,
};

/* What a host would do next, so that random calls meet instances in every phase. */
static void advance(Instance *instance) {
    switch (instance->phase) {
        case CREATED: setup(instance), enter_initialization(instance); break;
        case INITIALIZING:
            exit_initialization(instance);
            if (instance->phase == INITIALIZING && happens(0.5)) reset(instance); /* some value is refused */
            break;
        case STEPPING: do_step(instance); break;
        case EVENTS: new_discrete_states(instance), enter_continuous_time(instance); break;
        case CONTINUOUS: (happens(0.3) ? enter_events : ONE_OF(exchange_actions))(instance); break;
        case TERMINATED: reset(instance); break;
    }
}

static void act(void) {
    Instance *instance = &instances[below(INSTANCES)];
    if (instance->component == NULL)
        create_instance(instance);
    else if (happens(0.4))
        advance(instance);
    else if (happens(0.03))
        ONE_OF(rare_actions)(instance);
    else if (offers_model_exchange() && happens(instance->type == fmi2CoSimulation ? 0.1 : 0.5))
        ONE_OF(exchange_actions)(instance);
    else
        ONE_OF(actions)(instance);
}

static void run_burst(void) {
    static const double kinds[] = {0.02, 0.1, 0.3, 0.8};
    wildness = ONE_OF(kinds);
    for (size_t n = 100 + below(300); n > 0; n--) act();
    for (size_t i = 0; i < INSTANCES; i++)
        if (instances[i].component != NULL) free_instance(&instances[i]);
}

/* ---- a fresh instance ------------------------------------------------------------------ */

static void must(fmi2Status status, const char *call) {
    if (status > fmi2Warning) fail("%s answers a fresh instance with %s", call, status_name(status));
}

static fmi2Component fresh(const Library *library) {
    static const fmi2CallbackFunctions callbacks = {0};
    fmi2Component c = library->fmu.Instantiate("fresh", fmi2CoSimulation, library->guid, NULL, &callbacks,
                                               fmi2False, fmi2False);
    if (c == NULL) fail("a fresh instance cannot be instantiated");
    must(library->fmu.SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0), "fmi2SetupExperiment");
    must(library->fmu.EnterInitializationMode(c), "fmi2EnterInitializationMode");
    must(library->fmu.ExitInitializationMode(c), "fmi2ExitInitializationMode");
    return c;
}

/* The outputs of a fresh instance at every step of a run with moving inputs. */
static void run_fresh(double *rows) {
    fmi2Component c = fresh(&model);
    for (int k = 0; k < REFERENCE_STEPS; k++) {
        for (size_t i = 0; i < n_variables; i++) {
            const double value = variables[i].start + 1e-2 * (double)((k * 7 + (int)i * 3) % 11);
            if (variables[i].role == 'i' && variables[i].type == 'r')
                must(model.fmu.SetReal(c, &variables[i].reference, 1, &value), "fmi2SetReal");
        }
        must(model.fmu.DoStep(c, k * REFERENCE_STEP, REFERENCE_STEP, fmi2True), "fmi2DoStep");
        must(model.fmu.GetReal(c, outputs, n_outputs, rows + (size_t)k * n_outputs), "fmi2GetReal");
    }
    model.fmu.FreeInstance(c);
}

/* ---- the plan and the whole ------------------------------------------------------------ */

static int read_library(Library *library, const char *line) {
    char path[4096];
    if (sscanf(line, "%*s %127s %4095[^\n]", library->guid, path) != 2) return 0;
    const char *problem = load_fmu(&library->fmu, path);
    if (problem != NULL) fail("%s", problem);
    return 1;
}

static int read_variable(const char *line) {
    Variable *v = &variables[n_variables];
    if (sscanf(line, "%*s %c %u %c %lf %lf %lf", &v->type, &v->reference, &v->role, &v->start, &v->low,
               &v->high) != 6)
        return 0;
    if (v->type == 'r' && strchr("os", v->role) != NULL) outputs[n_outputs++] = v->reference;
    n_variables++;
    return 1;
}

static int read_statement(const char *line) {
    char word[16], name[128];
    if (sscanf(line, "%15s", word) != 1) return 0;
    if (strcmp(word, "model") == 0) return read_library(&model, line);
    if (strcmp(word, "foreign") == 0) return read_library(&foreign, line);
    if (strcmp(word, "continuous") == 0) return sscanf(line, "%*s %zu %zu", &n_states, &n_indicators) == 2;
    if (strcmp(word, "internal_step") == 0) return sscanf(line, "%*s %ld", &internal_step) == 1;
    if (strcmp(word, "variable") == 0 && n_variables < MAXIMUM_VARIABLES) return read_variable(line);
    if (strcmp(word, "category") == 0 && n_categories < MAXIMUM_CATEGORIES) {
        const int found = sscanf(line, "%*s %127s", name);
        categories[n_categories++] = copied(name);
        return found == 1;
    }
    return 0;
}

static void read_plan(const char *path) {
    FILE *file = fopen(path, "r");
    char *line = NULL;
    size_t room = 0;
    if (file == NULL) fail("cannot read the plan %s", path);
    while (getline(&line, &room, file) >= 0)
        if (!read_statement(line)) fail("the plan has a line that cannot be used: %s", line);
    free(line);
    fclose(file);
    if (model.fmu.DoStep == NULL || foreign.fmu.DoStep == NULL || n_variables == 0 || n_categories == 0)
        fail("the plan %s is not complete", path);
}

static double seconds_since_start(void) {
    static double start = -1.0;
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    const double seconds = (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
    if (start < 0.0) start = seconds;
    return seconds - start;
}

static void print_counts(long bursts) {
    printf("bursts %ld\n", bursts);
    for (int f = 0; f < (offers_model_exchange() ? N_FUNCTIONS : FIRST_MODEL_EXCHANGE_FUNCTION); f++) {
        printf("%s", function_names[f]);
        for (int status = fmi2OK; status <= fmi2Error; status++) printf(" %ld", counts[f][status]);
        printf("\n");
    }
}

int main(int count, char **arguments) {
    unsigned long seed = 1, first = 0;
    long bursts = LONG_MAX;
    double seconds = INFINITY;
    for (int option; (option = getopt(count, arguments, "s:b:n:t:v")) != -1;) {
        if (option == 's') seed = strtoul(optarg, NULL, 10);
        else if (option == 'b') first = strtoul(optarg, NULL, 10);
        else if (option == 'n') bursts = atol(optarg);
        else if (option == 't') seconds = atof(optarg);
        else if (option == 'v') verbose = 1;
        else return 1;
    }
    if (count - optind != 1 || (bursts == LONG_MAX && seconds == INFINITY))
        fail("usage: fuzz [-s SEED] [-b FIRST_BURST] [-n BURSTS | -t SECONDS] [-v] PLAN");
    watch_for_death();
    read_plan(arguments[optind]);

    const size_t size = REFERENCE_STEPS * n_outputs * sizeof(double);
    double *expected = allocate(1, size), *found = allocate(1, size);
    run_fresh(expected);
    stranger = fresh(&foreign);
    must(foreign.fmu.GetFMUstate(stranger, &strange_state), "fmi2GetFMUstate");
    long done = 0;
    for (; done < bursts && seconds_since_start() < seconds; done++) {
        const unsigned long burst = first + (unsigned long)done;
        note_how_to_repeat(arguments[0], seed, burst, 1, arguments[optind]);
        seed_random(seed, burst);
        alarm(BURST_LIMIT);
        run_burst();
        run_fresh(found);
        if (memcmp(found, expected, size) != 0) fail("a fresh instance gives other results than at first");
    }
    alarm(0);
    note_how_to_repeat(arguments[0], seed, first, done, arguments[optind]); /* leaks show at the end */
    foreign.fmu.FreeFMUstate(stranger, &strange_state);
    foreign.fmu.FreeInstance(stranger);
    free(expected), free(found);
    for (size_t i = 0; i < n_categories; i++) free(categories[i]);
    print_counts(done);
    return 0;
}
