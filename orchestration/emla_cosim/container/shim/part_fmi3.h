/* Calls of parts of FMI 3.0, without event mode, early return and intermediate update. */

#define CALL_3(instance, part, name) ((instance)->functions[parts[part].library].three.name)

static void pass_on_3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                      fmi3String message) {
    (void)category;
    if (message != NULL && hears(environment, (Status)status)) relay(environment, (Status)status, message);
}

/* It gets the path of its resources, not a URI. */
static fmi2Component instantiate_3(Instance *instance, int i, const char *location) {
    char *path = location == NULL ? NULL : path_of(location, "/");
    const fmi3Instance made = CALL_3(instance, i, InstantiateCoSimulation)(
        parts[i].name, libraries[parts[i].library].guid, path, fmi3False, fmi3True, fmi3False, fmi3False, NULL, 0,
        &instance->senders[i], pass_on_3, NULL);
    free(path);
    return made;
}

static fmi2Status enter_3(Instance *instance, int i, const Experiment *experiment) {
    const int stops = isfinite(experiment->stop);
    return (fmi2Status)CALL_3(instance, i, EnterInitializationMode)(
        instance->parts[i], experiment->tolerance > 0.0, experiment->tolerance, experiment->start, stops,
        stops ? experiment->stop : 0.0);
}

#define SET(letter, Name, lowest, limit)                                                             \
    case letter: {                                                                                   \
        fmi3##Name *converted = (void *)instance->converted;                                         \
        for (size_t k = 0; k < count; k++) converted[k] = (fmi3##Name)values[k];                     \
        return (fmi2Status)CALL_3(instance, i, Set##Name)(c, references, n, converted, count);       \
    }
#define GET(letter, Name, lowest, limit)                                                                     \
    case letter: {                                                                                           \
        fmi3##Name *converted = (void *)instance->converted;                                                 \
        memset(converted, 0, count * sizeof *converted);                                                     \
        const fmi3Status status = CALL_3(instance, i, Get##Name)(c, references, n, converted, count);        \
        for (size_t k = 0; k < count && !is_bad((fmi2Status)status); k++) values[k] = (double)converted[k]; \
        return (fmi2Status)status;                                                                           \
    }

/* The values fit into their type. */
static fmi2Status set_3(Instance *instance, int i, char type, const fmi2ValueReference *references, size_t n,
                        const double *values, size_t count) {
    const fmi3Instance c = instance->parts[i];
    switch (type) {
        WHOLE_TYPES(SET)
        OTHER_TYPES(SET)
        default: return (fmi2Status)CALL_3(instance, i, SetFloat64)(c, references, n, values, count);
    }
}

static fmi2Status get_3(Instance *instance, int i, char type, const fmi2ValueReference *references, size_t n,
                        double *values, size_t count) {
    const fmi3Instance c = instance->parts[i];
    switch (type) {
        WHOLE_TYPES(GET)
        OTHER_TYPES(GET)
        default: return (fmi2Status)CALL_3(instance, i, GetFloat64)(c, references, n, values, count);
    }
}

static fmi2Status set_text_3(Instance *instance, int i, fmi2ValueReference reference, const char *text) {
    return (fmi2Status)CALL_3(instance, i, SetString)(instance->parts[i], &reference, 1, &text, 1);
}

static fmi2Status get_text_3(Instance *instance, int i, fmi2ValueReference reference, const char **text) {
    return (fmi2Status)CALL_3(instance, i, GetString)(instance->parts[i], &reference, 1, text, 1);
}

/* `judge_step` of the master. */
static fmi2Status step_3(Instance *instance, int i, double time, double length, int no_way_back, int *ends) {
    fmi3Boolean wants_event = fmi3False, terminates = fmi3False, is_early = fmi3False;
    fmi3Float64 reached = time;
    const fmi2Status status = (fmi2Status)CALL_3(instance, i, DoStep)(
        instance->parts[i], time, length, no_way_back != 0, &wants_event, &terminates, &is_early, &reached);
    *ends = terminates;
    if (is_bad(status)) return status;
    if (terminates) return fmi2Discard;
    if (is_early)
        report(instance, StatusError, "%s returned early at t = %.9g s, which was not allowed.", parts[i].name,
               reached);
    else if (wants_event)
        report(instance, StatusError, "%s asked for event mode, which is not used.", parts[i].name);
    return is_early || wants_event ? fmi2Error : status;
}

static const Version version_3 = {"fmi3", instantiate_3, NULL,       enter_3, set_3,
                                  get_3,  set_text_3,    get_text_3, step_3};
