/* Instances of the parts. */

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
    instance->parts[i] = version_of(i)->instantiate(instance, i, location);
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

/* Set a number of a part, in the part's own unit. An array is set as a whole. */
static fmi2Status set_number(Instance *instance, const Variable *variable, double value) {
    double *array = variable->elements < 0 ? &value : &instance->memory.elements[variable->elements];
    const double before = array[variable->place];
    array[variable->place] = value;
    const fmi2Status status = version_of(variable->part)
                                  ->set(instance, variable->part, variable->own, &variable->reference, 1, array,
                                        (size_t)variable->size);
    if (is_bad(status)) array[variable->place] = before;
    return status;
}

/* Get a number of a part, in the part's own unit. */
static fmi2Status get_number(Instance *instance, const Variable *variable, double *value) {
    const fmi2Status status = version_of(variable->part)
                                  ->get(instance, variable->part, variable->own, &variable->reference, 1,
                                        instance->numbers, (size_t)variable->size);
    if (!is_bad(status)) *value = instance->numbers[variable->place];
    return status;
}
