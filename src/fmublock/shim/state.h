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

static Status check_state(const Instance *instance, const State *state) {
    if (state == NULL || memcmp(state->guid, GUID(&instance->now), sizeof state->guid) != 0)
        return report(instance, StatusError, "this is not a state of %s %s.", MODEL_IDENTIFIER,
                      GUID(&instance->now));
    if (state->type != instance->now.type)
        return report(instance, StatusError, "states of Co-Simulation and Model Exchange are not compatible.");
    return StatusOK;
}

static Status copy_state(const Instance *instance, const State *source, FmuState *target) {
    if (check_place(instance, target, "the state") != StatusOK) return StatusError;
    if (*target != NULL && check_state(instance, *target) != StatusOK) return StatusError;
    if (*target == NULL) *target = malloc(sizeof(State));
    if (*target == NULL) return report(instance, StatusError, "out of memory.");
    memcpy(*target, source, sizeof(State));
    ((State *)*target)->resource = NULL;
    return StatusOK;
}

Status FMI(GetFMUState)(Handle c, FmuState *FMUState) {
    Instance *instance = c;
    if (require(instance, ~INTERMEDIATE_UPDATE, "get the state") != StatusOK) return StatusError;
    return copy_state(instance, &instance->now, FMUState);
}

/* Going back further than the host promised works, but gives a warning, as other FMUs may fail. */
Status FMI(SetFMUState)(Handle c, FmuState FMUState) {
    Instance *instance = c;
    const double *resource = instance->now.resource;
    if (require(instance, ~INTERMEDIATE_UPDATE, "set the state") != StatusOK) return StatusError;
    if (check_state(instance, FMUState) != StatusOK) return StatusError;
    memcpy(&instance->now, FMUState, sizeof instance->now);
    instance->now.resource = resource;
    if (instance->now.time >= instance->no_return_before) return StatusOK;
    return report(instance, StatusWarning,
                  "set back to t = %.9g s, though noSetFMUStatePriorToCurrentPoint was given at t = %.9g s.",
                  instance->now.time, instance->no_return_before);
}

Status FMI(FreeFMUState)(Handle c, FmuState *FMUState) {
    (void)c;
    if (FMUState != NULL) {
        free(*FMUState);
        *FMUState = NULL;
    }
    return StatusOK;
}

Status FMI(SerializedFMUStateSize)(Handle c, FmuState FMUState, size_t *size) {
    if (check_state(c, FMUState) != StatusOK) return StatusError;
    if (check_place(c, size, "the size") != StatusOK) return StatusError;
    *size = sizeof(Serialized);
    return StatusOK;
}

Status FMI(SerializeFMUState)(Handle c, FmuState FMUState, Byte serializedState[],
                                 size_t size) {
    Serialized serialized = {0};
    if (check_state(c, FMUState) != StatusOK) return StatusError;
    if (check_place(c, serializedState, "the bytes") != StatusOK) return StatusError;
    if (size < sizeof serialized)
        return report(c, StatusError, "a state needs %u bytes, not %u.", (unsigned)sizeof serialized,
                      (unsigned)size);
    memcpy(&serialized.state, FMUState, sizeof serialized.state);
    conceal(&serialized.state);
    serialized.checksum = checksum(&serialized.state);
    memcpy(serializedState, &serialized, sizeof serialized);
    return StatusOK;
}

Status FMI(DeserializeFMUState)(Handle c, const Byte serializedState[], size_t size,
                                   FmuState *FMUState) {
    Serialized serialized;
    if (check_place(c, serializedState, "the bytes") != StatusOK) return StatusError;
    if (size != sizeof serialized)
        return report(c, StatusError, "a state has %u bytes, not %u.", (unsigned)sizeof serialized,
                      (unsigned)size);
    memcpy(&serialized, serializedState, sizeof serialized);
    if (check_state(c, &serialized.state) != StatusOK) return StatusError;
    if (serialized.checksum != checksum(&serialized.state))
        return report(c, StatusError, "the serialized state is damaged.");
    reveal(&serialized.state);
    return copy_state(c, &serialized.state, FMUState);
}
