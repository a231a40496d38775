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
    memset(instance->is_chosen, 0, sizeof instance->is_chosen);
    strcpy(instance->memory.guid, MODEL_GUID);
    instance->memory.phase = INSTANTIATED;
    instance->memory.stop_time = HUGE_VAL;
    instance->memory.start_time = START_TIME;
    instance->defines_tolerance = 0;
    instance->ended = 0;
    instance->settled = 0;
    for (int i = 0; i < N_STARTS; i++)
        if (starts[i].text == NULL) {
            instance->chosen[starts[i].variable] = starts[i].value;
            instance->is_chosen[starts[i].variable] = 1;
        }
}

/* Set the start values, which the system or the host chose. */
static fmi2Status set_chosen(Instance *instance) {
    for (int v = 0; v < N_VARIABLES; v++) {
        const Variable *variable = &variables[v];
        if (!instance->is_chosen[v]) continue;
        const fmi2Status status = set_number(instance, variable->part, variable->reference, variable->type,
                                             instance->chosen[v]);
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

/* The category's bit; all of them for logAll, 0 for an unknown category. */
static unsigned category_bits(fmi2String name) {
    for (int i = 0; i < N_CATEGORIES && name != NULL; i++)
        if (strcmp(name, categories[i]) == 0) return i == LOG_ALL ? EVERYTHING : CATEGORY(i);
    return 0;
}

/* On: log only these categories, or all if none are named. Off: stop logging these, or all. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String names[]) {
    Instance *instance = c;
    unsigned named = nCategories == 0 ? EVERYTHING : 0;
    if (check_arrays(instance, nCategories, names, names) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nCategories; i++) {
        const unsigned bits = category_bits(names[i]);
        if (bits == 0)
            return report(instance, fmi2Error, "there is no log category %.100s.",
                          names[i] == NULL ? "(none)" : names[i]);
        named |= bits;
    }
    instance->logged = loggingOn ? named : instance->logged & ~named;
    return fmi2OK;
}

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
    if (!isfinite(startTime))
        return report(instance, fmi2Error, "the start time %g is not a finite number of seconds.", startTime);
    if (stopTimeDefined && !(stopTime >= startTime))
        return report(instance, fmi2Error, "the stop time %g s is not after the start time %g s.", stopTime,
                      startTime);
    if (toleranceDefined && !(tolerance > 0.0 && isfinite(tolerance)))
        return report(instance, fmi2Error, "the tolerance %g is not a positive number.", tolerance);
    instance->memory.start_time = startTime;
    instance->memory.stop_time = stopTimeDefined ? stopTime : HUGE_VAL;
    instance->defines_tolerance = toleranceDefined != fmi2False;
    instance->tolerance = tolerance;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *instance = c;
    Memory *memory = &instance->memory;
    if (require(instance, INSTANTIATED, "enter initialization mode") != fmi2OK) return fmi2Error;
    for (int i = 0; i < N_PARTS; i++) {
        const double tolerance = instance->defines_tolerance ? instance->tolerance : parts[i].tolerance;
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
