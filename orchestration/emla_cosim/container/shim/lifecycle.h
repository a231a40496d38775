/* Create, initialize, terminate, reset and free. */

const char *FMI(GetVersion)(void) { return FMI(Version); }

static char *copy_text(const char *text) {
    char *copy = malloc(strlen(text) + 1);
    return copy == NULL ? NULL : strcpy(copy, text);
}

static Status check_identity(const Instance *instance, String name, int type, String guid) {
    if (name == NULL || *name == '\0')
        return report(instance, StatusError, "an instance needs a name; this one is %s.",
                      name == NULL ? "NULL" : "empty");
    if (type != FOR_CO_SIMULATION) return report(instance, StatusError, "this FMU is for co-simulation only.");
    if (guid == NULL || strcmp(guid, MODEL_GUID) != 0)
        return report(instance, StatusError, "the " TOKEN_NAME " %.100s is not this FMU's, %s.",
                      guid == NULL ? "(none)" : guid, MODEL_GUID);
    return StatusOK;
}

/* The state of a new instance, apart from its parts. */
static void begin_memory(Instance *instance) {
    memset(&instance->memory, 0, sizeof instance->memory);
    strcpy(instance->memory.guid, MODEL_GUID);
    instance->memory.phase = INSTANTIATED;
    instance->memory.stop_time = HUGE_VAL;
    instance->memory.start_time = START_TIME;
    begin_arrays(instance->memory.saved);
    instance->settled = 0;
    for (int i = 0; i < N_STARTS; i++)
        if (starts[i].text == NULL) {
            instance->memory.chosen[starts[i].variable] = starts[i].value;
            instance->memory.is_chosen[starts[i].variable] = 1;
        }
}

/* Let the stepper use the times of the memory. */
static void use_memory(Instance *instance) {
    instance->stepper.clock = instance->memory.clock;
    instance->stepper.last_point = instance->memory.stop_time;
    for (int i = 0; i < N_PARTS && instance->goes_back; i++) instance->instances[i].has_no_way_back = 0;
}

/* Set the start values, which the system or the host chose. */
static Status set_chosen(Instance *instance) {
    for (int v = 0; v < N_VARIABLES; v++) {
        const Variable *variable = &variables[v];
        if (!instance->memory.is_chosen[v]) continue;
        const int32_t status = set_number(instance, variable, instance->memory.chosen[v]);
        if (is_bad(status)) return blame_part(instance, variable->part, variable->name, status);
    }
    return StatusOK;
}

static Status begin_parts(Instance *instance) {
    if (make_parts(instance) != StatusOK) return StatusError;
    wire(instance);
    use_memory(instance);
    if (set_chosen(instance) != StatusOK) return StatusError;
    for (int i = 0; i < N_STARTS; i++) {
        const Variable *variable = &variables[starts[i].variable];
        if (starts[i].text == NULL) continue;
        const int32_t status = set_text(instance, variable->part, AT_ONCE, variable->reference, starts[i].text);
        if (is_bad(status)) return blame_part(instance, variable->part, variable->name, status);
    }
    return StatusOK;
}

/* Return a new instance, or NULL after a message. `location` is a URI, or NULL. */
static Handle create_instance(String name, String guid, const char *location, int type, Boolean logging,
                              Logger logger, Environment environment) {
    Instance *instance = calloc(1, sizeof *instance);
    if (instance == NULL) return NULL;
    instance->name = copy_text(name != NULL && *name ? name : MODEL_IDENTIFIER);
    instance->location = location == NULL ? NULL : copy_text(location);
    instance->logger = logger;
    instance->environment = environment;
    instance->logged = logging ? EVERYTHING : PROBLEMS;
    begin_memory(instance);
    if (instance->name != NULL && check_identity(instance, name, type, guid) == StatusOK &&
        open_libraries(instance) == StatusOK && begin_parts(instance) == StatusOK)
        return instance;
    FMI(FreeInstance)(instance);
    return NULL;
}

void FMI(FreeInstance)(Handle c) {
    Instance *instance = c;
    if (instance == NULL) return;
    free_parts(instance);
    if (instance->memory.phase != DEAD) close_libraries(instance);
    free(instance->name);
    free(instance->location);
    free(instance);
}

#include "logging.h"

/* The communication points from a start time: exact decimal numbers where the start allows it. */
static Clock make_clock(double start) {
    const Clock given = {CLOCK_FIRST, CLOCK_PER_STEP, CLOCK_DENOMINATOR};
    if (start == START_TIME) return given;
    const double first = rint(start * given.denominator);
    if (fabs(first) < 9007199254740992.0 && first / given.denominator == start)
        return (Clock){first, given.per_step, given.denominator};
    return (Clock){start, STEP_SIZE, 1.0};
}

static Status set_experiment(Instance *instance, Boolean toleranceDefined, double tolerance, double startTime,
                             Boolean stopTimeDefined, double stopTime) {
    if (check_experiment(instance, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime) != StatusOK)
        return StatusError;
    instance->memory.start_time = startTime;
    instance->memory.stop_time = stopTimeDefined ? stopTime : HUGE_VAL;
    instance->memory.tolerance = toleranceDefined ? tolerance : 0.0;
    return StatusOK;
}

static Experiment experiment_of(const Memory *memory, int i) {
    const double tolerance = memory->tolerance > 0.0 ? memory->tolerance : parts[i].tolerance;
    return (Experiment){tolerance, memory->start_time, memory->stop_time};
}

static Status enter_initialization(Instance *instance) {
    Memory *memory = &instance->memory;
    for (int i = 0; i < N_PARTS; i++) {
        const Experiment experiment = experiment_of(memory, i);
        const int32_t status = set_up(instance, i, &experiment);
        if (is_bad(status)) return blame_part(instance, i, "fmi2SetupExperiment", status);
    }
    if (set_chosen(instance) != StatusOK) return failed(instance); /* some FMUs forget values in fmi2SetupExperiment */
    for (int i = 0; i < N_PARTS; i++) {
        const Experiment experiment = experiment_of(memory, i);
        const int32_t status = enter(instance, i, &experiment);
        if (is_bad(status)) return blame_part(instance, i, "the start of initialization", status);
    }
    memory->phase = INITIALIZATION;
    memory->clock = make_clock(memory->start_time);
    memory->steps = 0;
    use_memory(instance);
    memset(memory->saved, 0, N_RESTORED * sizeof(double));
    if (N_JACOBIANS > 0) memcpy(&memory->saved[N_RESTORED], first_jacobians, N_JACOBIANS * sizeof(double));
    for (int i = 0; i < N_PARTS; i++) forget_events(instance, i);
    assume_inputs(instance);
    instance->settled = 0;
    return StatusOK;
}

static Status exit_part(Instance *instance, int i) {
    if (start_events(instance, i) != StatusOK) return StatusError;
    fmi2ExitInitializationModeTYPE *exit = CALL(instance, i, ExitInitializationMode, ExitInitializationMode);
    const int32_t status = (int32_t)exit(instance->parts[i]);
    if (is_bad(status)) return blame_part(instance, i, "the end of initialization", status);
    return handle_first_events(instance, i);
}

static void begin_history(Instance *instance) {
    const Stepper *s = &instance->stepper;
    for (int k = PREVIOUS; k < N_STORES; k++) memcpy(s->stores[k], s->stores[SIGNALS], N_SIGNALS * sizeof(double));
    for (int i = 0; i < N_PARTS; i++) s->at[i] = s->before[i] = instance->memory.start_time;
    for (int j = 0; j < N_INPUTS; j++) {
        s->taken[j] = s->stores[SIGNALS][s->inputs[j].signal];
        s->taken_at[j] = instance->memory.start_time;
    }
}

Status FMI(ExitInitializationMode)(Handle c) {
    Instance *instance = c;
    if (require(instance, INITIALIZATION, "exit initialization mode") != StatusOK) return StatusError;
    if (settle(instance) != StatusOK) return failed(instance);
    for (int i = 0; i < N_PARTS; i++) /* inputs that no initial value depends on */
        if (pass_inputs(instance, i) != StatusOK) return failed(instance);
    for (int i = 0; i < N_PARTS; i++)
        if (exit_part(instance, i) != StatusOK) return failed(instance);
    instance->memory.phase = STEP;
    for (int i = 0; i < N_PARTS; i++)
        if (read_outputs(instance, i) != StatusOK) return failed(instance);
    for (int i = 0; i < N_PARTS; i++)
        if (pass_inputs(instance, order[i]) != StatusOK) return failed(instance);
    const int bad = find_not_finite(&instance->stepper);
    if (bad >= 0) {
        instance->memory.phase = FAILED;
        return report(instance, StatusError, "%s is %g at the start.", signal_names[bad],
                      instance->stepper.stores[SIGNALS][bad]);
    }
    begin_history(instance);
    return StatusOK;
}

Status FMI(Terminate)(Handle c) {
    Instance *instance = c;
    if (require(instance, STEP, "terminate") != StatusOK) return StatusError;
    for (int i = 0; i < N_PARTS; i++) {
        const int32_t status = (int32_t)CALL(instance, i, Terminate, Terminate)(instance->parts[i]);
        if (is_bad(status)) return blame_part(instance, i, "its termination", status);
    }
    instance->memory.phase = TERMINATED;
    return StatusOK;
}

/* The parts are made anew, because some FMUs keep a part of their state in fmi2Reset. */
Status FMI(Reset)(Handle c) {
    Instance *instance = c;
    if (require(instance, ~DEAD, "reset") != StatusOK) return StatusError;
    free_parts(instance);
    begin_memory(instance);
    if (begin_parts(instance) == StatusOK) return StatusOK;
    if (instance->memory.phase != DEAD) instance->memory.phase = FAILED;
    return failed(instance);
}
