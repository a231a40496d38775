/* The FMU state: saved, restored, serialized. */

typedef struct {
    State state;
    uint64_t checksum;
} Serialized;

/* FNV-1a checksum, which reveals damaged states. */
static uint64_t checksum(const State *state) {
    const unsigned char *bytes = (const unsigned char *)state;
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < sizeof *state; i++) hash = (hash ^ bytes[i]) * 1099511628211u;
    return hash;
}

/* Remove hidden parameters, and what follows from parameters, from a state that leaves the FMU as bytes. */
static void conceal(State *state) {
    int hides = 0;
    for (int r = N_INPUTS; r < FIRST_STATE; r++)
        if (variables[r].access == 'H') {
            state->values[r] = 0.0;
            hides = 1;
        }
    if (hides) memset(state->fixed, 0, sizeof state->fixed);
}

/* Restore what `conceal` removed. */
static void reveal(State *state) {
    int hides = 0;
    for (int r = N_INPUTS; r < FIRST_STATE; r++)
        if (variables[r].access == 'H') {
            state->values[r] = variables[r].start;
            hides = 1;
        }
    if (hides) fix_values(state);
}

static fmi2Status check_state(const Instance *instance, const State *state) {
    if (state == NULL || memcmp(state->guid, GUID(&instance->now), sizeof state->guid) != 0)
        return report(instance, fmi2Error, "this is not a state of %s %s.", MODEL_IDENTIFIER,
                      GUID(&instance->now));
    if (state->type != instance->now.type)
        return report(instance, fmi2Error, "states of Co-Simulation and Model Exchange are not compatible.");
    return fmi2OK;
}

static fmi2Status copy_state(const Instance *instance, const State *source, fmi2FMUstate *target) {
    if (check_place(instance, target, "the state") != fmi2OK) return fmi2Error;
    if (*target != NULL && check_state(instance, *target) != fmi2OK) return fmi2Error;
    if (*target == NULL) *target = malloc(sizeof(State));
    if (*target == NULL) return report(instance, fmi2Error, "out of memory.");
    memcpy(*target, source, sizeof(State));
    ((State *)*target)->resource = NULL;
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    Instance *instance = c;
    return copy_state(instance, &instance->now, FMUstate);
}

/* Going back further than the host promised works, but gives a warning, as other FMUs may fail. */
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    Instance *instance = c;
    const double *resource = instance->now.resource;
    if (check_state(instance, FMUstate) != fmi2OK) return fmi2Error;
    memcpy(&instance->now, FMUstate, sizeof instance->now);
    instance->now.resource = resource;
    if (instance->now.time >= instance->no_return_before) return fmi2OK;
    return report(instance, fmi2Warning,
                  "set back to t = %.9g s, though noSetFMUStatePriorToCurrentPoint was given at t = %.9g s.",
                  instance->now.time, instance->no_return_before);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    (void)c;
    if (FMUstate != NULL) {
        free(*FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    if (check_state(c, FMUstate) != fmi2OK) return fmi2Error;
    if (check_place(c, size, "the size") != fmi2OK) return fmi2Error;
    *size = sizeof(Serialized);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                 size_t size) {
    Serialized serialized = {0};
    if (check_state(c, FMUstate) != fmi2OK) return fmi2Error;
    if (check_place(c, serializedState, "the bytes") != fmi2OK) return fmi2Error;
    if (size < sizeof serialized)
        return report(c, fmi2Error, "a state needs %u bytes, not %u.", (unsigned)sizeof serialized,
                      (unsigned)size);
    memcpy(&serialized.state, FMUstate, sizeof serialized.state);
    conceal(&serialized.state);
    serialized.checksum = checksum(&serialized.state);
    memcpy(serializedState, &serialized, sizeof serialized);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    Serialized serialized;
    if (check_place(c, serializedState, "the bytes") != fmi2OK) return fmi2Error;
    if (size != sizeof serialized)
        return report(c, fmi2Error, "a state has %u bytes, not %u.", (unsigned)sizeof serialized,
                      (unsigned)size);
    memcpy(&serialized, serializedState, sizeof serialized);
    if (check_state(c, &serialized.state) != fmi2OK) return fmi2Error;
    if (serialized.checksum != checksum(&serialized.state))
        return report(c, fmi2Error, "the serialized state is damaged.");
    reveal(&serialized.state);
    return copy_state(c, &serialized.state, FMUstate);
}
