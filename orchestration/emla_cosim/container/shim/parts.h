/* Instances of the parts: calls that differ between the versions of FMI. */

/* A function of a part, of its type in FMI 2.0; those with equal arguments have equal statuses in FMI 3.0. */
#ifdef HAS_FMI3_PARTS
#define CALL(instance, part, Name, Name3)                                                                  \
    ((fmi2##Name##TYPE *)(instance)->functions[parts[part].library][is_version_3(part) ? (int)FMI3_##Name3 \
                                                                                       : (int)FMI2_##Name])
#define CALL_3(instance, part, Name) ((fmi3##Name##TYPE *)(instance)->functions[parts[part].library][FMI3_##Name])
#else
#define CALL(instance, part, Name, Name3) \
    ((fmi2##Name##TYPE *)(instance)->functions[parts[part].library][FMI2_##Name])
#endif
#define CALL_2(instance, part, Name) ((fmi2##Name##TYPE *)(instance)->functions[parts[part].library][FMI2_##Name])

/* ---- instantiate ---- */

static void *allocate(size_t n, size_t size) { return calloc(n, size); }

/* Pass on a message of a part. */
static void pass_on_2(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                      fmi2String category, fmi2String format, ...) {
    char text[2 * MESSAGE_LENGTH];
    va_list arguments;
    (void)name, (void)category;
    if (format == NULL || !hears(environment, (Status)status)) return;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    relay(environment, (Status)status, text);
}

static fmi2Component instantiate_2(Instance *instance, int i, const char *location) {
    fmi2CallbackFunctions *callbacks = &instance->callbacks[i];
    const fmi2CallbackFunctions values = {pass_on_2, allocate, free, NULL, &instance->senders[i]};
    memcpy(callbacks, &values, sizeof values);
    return CALL_2(instance, i, Instantiate)(parts[i].name, fmi2CoSimulation, libraries[parts[i].library].guid,
                                            location, callbacks, fmi2False, fmi2True);
}

#ifdef HAS_FMI3_PARTS
static void pass_on_3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                      fmi3String message) {
    (void)category;
    if (message != NULL && hears(environment, (Status)status)) relay(environment, (Status)status, message);
}

/* It gets the path of its resources, not a URI. */
static fmi2Component instantiate_3(Instance *instance, int i, const char *location) {
    char *path = location == NULL ? NULL : path_of(location, "/");
    const fmi3Instance made = CALL_3(instance, i, InstantiateCoSimulation)(
        parts[i].name, libraries[parts[i].library].guid, path, fmi3False, fmi3True, parts[i].uses_event_mode,
        parts[i].may_return_early, NULL, 0, &instance->senders[i], pass_on_3, NULL);
    free(path);
    return made;
}
#endif

static Status make_part(Instance *instance, int i) {
    const Library *library = &libraries[parts[i].library];
    char *location = NULL;
    if (instance->location != NULL) {
        const size_t room = strlen(instance->location) + strlen(library->folder) + sizeof "//resources";
        location = malloc(room);
        if (location == NULL) return report(instance, StatusError, "out of memory.");
        snprintf(location, room, "%s/%s/resources", instance->location, library->folder);
    }
    instance->senders[i].self = &instance->senders[i];
    instance->senders[i].owner = instance;
    instance->senders[i].part = i;
#ifdef HAS_FMI3_PARTS
    instance->parts[i] = is_version_3(i) ? instantiate_3(instance, i, location) : instantiate_2(instance, i, location);
#else
    instance->parts[i] = instantiate_2(instance, i, location);
#endif
    free(location);
    if (instance->parts[i] != NULL) return StatusOK;
    return report(instance, StatusError, "%s cannot be instantiated.", parts[i].name);
}

static Status make_parts(Instance *instance) {
    for (int i = 0; i < N_PARTS; i++)
        if (make_part(instance, i) != StatusOK) return StatusError;
    return StatusOK;
}

/* Terminate and free all parts. After fmi2Fatal no function of any part may be called. */
static void free_parts(Instance *instance) {
    const int stepping = instance->memory.phase == STEP;
    if (instance->memory.phase == DEAD) return;
    for (int i = 0; i < N_PARTS; i++) {
        SavedState *state = &instance->states[i];
        if (instance->parts[i] == NULL) continue;
        if (state->state != NULL) CALL(instance, i, FreeFMUstate, FreeFMUState)(instance->parts[i], &state->state);
        if (stepping) CALL(instance, i, Terminate, Terminate)(instance->parts[i]);
        CALL(instance, i, FreeInstance, FreeInstance)(instance->parts[i]);
        instance->parts[i] = NULL;
        state->state = NULL;
    }
}

/* ---- initialize ---- */

/* What a part is told about the simulation; without a stop time, stop is not finite. */
typedef struct {
    double tolerance; /* 0 for the part's own */
    double start, stop;
} Experiment;

static int32_t set_up(Instance *instance, int i, const Experiment *experiment) {
    const int stops = isfinite(experiment->stop);
    if (is_version_3(i)) return fmi2OK;
    return (int32_t)CALL_2(instance, i, SetupExperiment)(
        instance->parts[i], experiment->tolerance > 0.0 ? fmi2True : fmi2False, experiment->tolerance,
        experiment->start, stops ? fmi2True : fmi2False, stops ? experiment->stop : 0.0);
}

static int32_t enter(Instance *instance, int i, const Experiment *experiment) {
#ifdef HAS_FMI3_PARTS
    const int stops = isfinite(experiment->stop);
    if (is_version_3(i))
        return (int32_t)CALL_3(instance, i, EnterInitializationMode)(
            instance->parts[i], experiment->tolerance > 0.0, experiment->tolerance, experiment->start, stops,
            stops ? experiment->stop : 0.0);
#else
    (void)experiment;
#endif
    return (int32_t)CALL_2(instance, i, EnterInitializationMode)(instance->parts[i]);
}
