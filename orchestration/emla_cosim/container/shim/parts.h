/* Instances of the parts. */

#define CALL(instance, part, name) ((instance)->functions[parts[part].library].name)

static void *allocate(size_t n, size_t size) { return calloc(n, size); }

static Status make_part(Instance *instance, int i) {
    const Library *library = &libraries[parts[i].library];
    fmi2CallbackFunctions *callbacks = &instance->callbacks[i];
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
    callbacks->logger = pass_on;
    callbacks->allocateMemory = allocate;
    callbacks->freeMemory = free;
    callbacks->stepFinished = NULL;
    callbacks->componentEnvironment = &instance->senders[i];
    instance->parts[i] = CALL(instance, i, Instantiate)(parts[i].name, fmi2CoSimulation, library->guid, location,
                                                        callbacks, fmi2False, fmi2True);
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
        if (instance->parts[i] == NULL) continue;
        if (instance->begin[i] != NULL) CALL(instance, i, FreeFMUstate)(instance->parts[i], &instance->begin[i]);
        if (stepping) CALL(instance, i, Terminate)(instance->parts[i]);
        CALL(instance, i, FreeInstance)(instance->parts[i]);
        instance->parts[i] = NULL;
        instance->begin[i] = NULL;
    }
}

/* Set a number of a part, in the part's own unit. */
static fmi2Status set_number(Instance *instance, int part, fmi2ValueReference reference, char type,
                             double value) {
    const fmi2Component c = instance->parts[part];
    if (type == 'R') return CALL(instance, part, SetReal)(c, &reference, 1, &value);
    if (type == 'I' || type == 'E') {
        const fmi2Integer whole = (fmi2Integer)value;
        return CALL(instance, part, SetInteger)(c, &reference, 1, &whole);
    }
    const fmi2Boolean truth = value != 0.0 ? fmi2True : fmi2False;
    return CALL(instance, part, SetBoolean)(c, &reference, 1, &truth);
}

/* Get a number of a part, in the part's own unit. */
static fmi2Status get_number(Instance *instance, int part, fmi2ValueReference reference, char type,
                             double *value) {
    const fmi2Component c = instance->parts[part];
    if (type == 'R') return CALL(instance, part, GetReal)(c, &reference, 1, value);
    if (type == 'I' || type == 'E') {
        fmi2Integer whole = 0;
        const fmi2Status status = CALL(instance, part, GetInteger)(c, &reference, 1, &whole);
        *value = (double)whole;
        return status;
    }
    fmi2Boolean truth = fmi2False;
    const fmi2Status status = CALL(instance, part, GetBoolean)(c, &reference, 1, &truth);
    *value = truth != fmi2False ? 1.0 : 0.0;
    return status;
}
