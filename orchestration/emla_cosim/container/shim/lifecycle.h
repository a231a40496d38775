/* Create, initialize, terminate, reset and free. */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

static char *copy_text(const char *text) {
    char *copy = malloc(strlen(text) + 1);
    return copy == NULL ? NULL : strcpy(copy, text);
}

static fmi2Status check_identity(const Instance *instance, fmi2String name, fmi2Type type, fmi2String guid) {
    if (name == NULL || *name == '\0')
        return report(instance, fmi2Error, "an instance needs a name; this one is %s.",
                      name == NULL ? "NULL" : "empty");
    if (type != fmi2CoSimulation) return report(instance, fmi2Error, "this FMU is for co-simulation only.");
    if (guid == NULL || strcmp(guid, MODEL_GUID) != 0)
        return report(instance, fmi2Error, "the GUID %.100s is not this FMU's, %s.",
                      guid == NULL ? "(none)" : guid, MODEL_GUID);
    return fmi2OK;
}

/* The state of a new instance, apart from its parts. */
static void begin_memory(Instance *instance) {
    memset(&instance->memory, 0, sizeof instance->memory);
    strcpy(instance->memory.guid, MODEL_GUID);
    instance->memory.phase = INSTANTIATED;
    instance->memory.stop_time = HUGE_VAL;
    instance->memory.start_time = START_TIME;
    instance->settled = 0;
    for (int i = 0; i < N_STARTS; i++)
        if (starts[i].text == NULL) {
            instance->memory.chosen[starts[i].variable] = starts[i].value;
            instance->memory.is_chosen[starts[i].variable] = 1;
        }
}

/* Set the start values, which the system or the host chose. */
static fmi2Status set_chosen(Instance *instance) {
    for (int v = 0; v < N_VARIABLES; v++) {
        const Variable *variable = &variables[v];
        if (!instance->memory.is_chosen[v]) continue;
        const fmi2Status status = set_number(instance, variable->part, variable->reference, variable->type,
                                             instance->memory.chosen[v]);
        if (is_bad(status)) return blame(instance, variable->part, variable->name, status);
    }
    return fmi2OK;
}

static fmi2Status begin_parts(Instance *instance) {
    if (make_parts(instance) != fmi2OK || set_chosen(instance) != fmi2OK) return fmi2Error;
    for (int i = 0; i < N_STARTS; i++) {
        const Variable *variable = &variables[starts[i].variable];
        if (starts[i].text == NULL) continue;
        const fmi2Status status = CALL(instance, variable->part, SetString)(
            instance->parts[variable->part], &variable->reference, 1, &starts[i].text);
        if (is_bad(status)) return blame(instance, variable->part, variable->name, status);
    }
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    (void)visible;
    Instance *instance = calloc(1, sizeof *instance);
    if (instance == NULL) return NULL;
    instance->name = copy_text(instanceName != NULL && *instanceName ? instanceName : MODEL_IDENTIFIER);
    instance->location = fmuResourceLocation == NULL ? NULL : copy_text(fmuResourceLocation);
    instance->logger = functions != NULL ? functions->logger : NULL;
    instance->environment = functions != NULL ? functions->componentEnvironment : NULL;
    instance->logged = loggingOn ? EVERYTHING : PROBLEMS;
    begin_memory(instance);
    if (instance->name != NULL && check_identity(instance, instanceName, fmuType, fmuGUID) == fmi2OK &&
        open_libraries(instance) == fmi2OK && begin_parts(instance) == fmi2OK)
        return instance;
    fmi2FreeInstance(instance);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c) {
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

static double point(const Clock *clock, double k) {
    return (clock->first + k * clock->per_step) / clock->denominator;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *instance = c;
    if (require(instance, INSTANTIATED, "set up the experiment") != fmi2OK) return fmi2Error;
    if (check_experiment(instance, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime) != fmi2OK)
        return fmi2Error;
    instance->memory.start_time = startTime;
    instance->memory.stop_time = stopTimeDefined ? stopTime : HUGE_VAL;
    instance->memory.tolerance = toleranceDefined ? tolerance : 0.0;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *instance = c;
    Memory *memory = &instance->memory;
    if (require(instance, INSTANTIATED, "enter initialization mode") != fmi2OK) return fmi2Error;
    for (int i = 0; i < N_PARTS; i++) {
        const double tolerance = memory->tolerance > 0.0 ? memory->tolerance : parts[i].tolerance;
        const fmi2Boolean stops = isfinite(memory->stop_time) ? fmi2True : fmi2False;
        const fmi2Status status = CALL(instance, i, SetupExperiment)(
            instance->parts[i], tolerance > 0.0 ? fmi2True : fmi2False, tolerance, memory->start_time, stops,
            stops ? memory->stop_time : 0.0);
        if (is_bad(status)) return blame(instance, i, "fmi2SetupExperiment", status);
    }
    if (set_chosen(instance) != fmi2OK) return failed(instance); /* some FMUs forget values in fmi2SetupExperiment */
    for (int i = 0; i < N_PARTS; i++) {
        const fmi2Status status = CALL(instance, i, EnterInitializationMode)(instance->parts[i]);
        if (is_bad(status)) return blame(instance, i, "fmi2EnterInitializationMode", status);
    }
    memory->phase = INITIALIZATION;
    memory->clock = make_clock(memory->start_time);
    memory->steps = 0.0;
    memset(&memory->now, 0, sizeof memory->now);
    memcpy(memory->jacobians, first_jacobians, sizeof memory->jacobians);
    assume_inputs(instance);
    instance->settled = 0;
    return fmi2OK;
}

static void begin_history(Instance *instance) {
    Exchange *now = &instance->memory.now;
    memcpy(now->previous, now->signals, sizeof now->previous);
    for (int i = 0; i < N_PARTS; i++) now->at[i] = now->before[i] = instance->memory.start_time;
    for (int j = 0; j < N_INPUTS; j++) {
        now->taken[j] = now->signals[inputs[j].signal];
        now->taken_at[j] = instance->memory.start_time;
    }
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, INITIALIZATION, "exit initialization mode") != fmi2OK) return fmi2Error;
    if (settle(instance) != fmi2OK) return failed(instance);
    for (int i = 0; i < N_PARTS; i++) /* inputs that no initial value depends on */
        if (pass_inputs(instance, i) != fmi2OK) return failed(instance);
    for (int i = 0; i < N_PARTS; i++) {
        const fmi2Status status = CALL(instance, i, ExitInitializationMode)(instance->parts[i]);
        if (is_bad(status)) return blame(instance, i, "fmi2ExitInitializationMode", status);
    }
    for (int i = 0; i < N_PARTS; i++)
        if (get_outputs(instance, i) != fmi2OK) return failed(instance);
    for (int i = 0; i < N_PARTS; i++)
        if (pass_inputs(instance, order[i]) != fmi2OK) return failed(instance);
    const int bad = find_not_finite(&instance->memory.now);
    if (bad >= 0) {
        instance->memory.phase = FAILED;
        return report(instance, fmi2Error, "%s is %g at the start.", signals[bad].name,
                      instance->memory.now.signals[bad]);
    }
    begin_history(instance);
    instance->memory.phase = STEP;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, STEP, "terminate") != fmi2OK) return fmi2Error;
    for (int i = 0; i < N_PARTS; i++) {
        const fmi2Status status = CALL(instance, i, Terminate)(instance->parts[i]);
        if (is_bad(status)) return blame(instance, i, "fmi2Terminate", status);
    }
    instance->memory.phase = TERMINATED;
    return fmi2OK;
}

/* The parts are made anew, because some FMUs keep a part of their state in fmi2Reset. */
fmi2Status fmi2Reset(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, ~DEAD, "reset") != fmi2OK) return fmi2Error;
    free_parts(instance);
    begin_memory(instance);
    if (begin_parts(instance) == fmi2OK) return fmi2OK;
    if (instance->memory.phase != DEAD) instance->memory.phase = FAILED;
    return failed(instance);
}
