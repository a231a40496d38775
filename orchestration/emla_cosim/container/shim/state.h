/* The FMU state: that of all parts, and of the exchange. */

#ifdef HAS_STATE

typedef struct {
    Memory memory;
    fmi2FMUstate parts[ROOM(N_PARTS)];
} State;

static fmi2Status check_state(const Instance *instance, const State *state) {
    if (state != NULL && memcmp(state->memory.guid, MODEL_GUID, GUID_SIZE) == 0) return fmi2OK;
    return report(instance, fmi2Error, "this is not a state of %s %s.", MODEL_IDENTIFIER, MODEL_GUID);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    Instance *instance = c;
    if (FMUstate == NULL || *FMUstate == NULL) return fmi2OK;
    State *state = *FMUstate;
    for (int i = 0; i < N_PARTS && instance->memory.phase != DEAD; i++)
        if (state->parts[i] != NULL) CALL(instance, i, FreeFMUstate)(instance->parts[i], &state->parts[i]);
    free(state);
    *FMUstate = NULL;
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    Instance *instance = c;
    if (require(instance, INSTANTIATED | INITIALIZATION | STEP | TERMINATED, "save the state") != fmi2OK)
        return fmi2Error;
    if (check_place(instance, FMUstate, "the state") != fmi2OK) return fmi2Error;
    if (*FMUstate != NULL && check_state(instance, *FMUstate) != fmi2OK) return fmi2Error;
    const int is_new = *FMUstate == NULL;
    State *state = is_new ? calloc(1, sizeof *state) : *FMUstate;
    if (state == NULL) return report(instance, fmi2Error, "out of memory.");
    for (int i = 0; i < N_PARTS; i++) {
        const fmi2Status status = CALL(instance, i, GetFMUstate)(instance->parts[i], &state->parts[i]);
        if (!is_bad(status)) continue;
        fmi2FMUstate whole = state;
        if (is_new) fmi2FreeFMUstate(instance, &whole);
        return blame(instance, i, "fmi2GetFMUstate", status);
    }
    state->memory = instance->memory;
    *FMUstate = state;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    Instance *instance = c;
    const State *state = FMUstate;
    if (require(instance, ~DEAD, "restore a state") != fmi2OK) return fmi2Error;
    if (check_state(instance, state) != fmi2OK) return fmi2Error;
    for (int i = 0; i < N_PARTS; i++) {
        const fmi2Status status = CALL(instance, i, SetFMUstate)(instance->parts[i], state->parts[i]);
        if (is_bad(status)) return blame(instance, i, "fmi2SetFMUstate", status);
    }
    instance->memory = state->memory;
    instance->settled = 0;
    return fmi2OK;
}

#else

static fmi2Status no_state(fmi2Component c) {
    return report(c, fmi2Error, "not all FMUs in this system can save their state.");
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) { return (void)FMUstate, no_state(c); }
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) { return (void)FMUstate, no_state(c); }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) { return (void)FMUstate, no_state(c); }

#endif

#ifdef HAS_SERIALIZATION

/* Bytes: the memory, then size and bytes of the state of each part, then a checksum (FNV-1a) of all. */

static uint64_t checksum(const unsigned char *bytes, size_t size) {
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < size; i++) hash = (hash ^ bytes[i]) * 1099511628211u;
    return hash;
}

static fmi2Status size_of_part(Instance *instance, const State *state, int i, size_t *size) {
    const fmi2Status status =
        CALL(instance, i, SerializedFMUstateSize)(instance->parts[i], state->parts[i], size);
    return is_bad(status) ? blame(instance, i, "fmi2SerializedFMUstateSize", status) : fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    Instance *instance = c;
    size_t all = sizeof(Memory) + sizeof(uint64_t);
    if (check_state(instance, FMUstate) != fmi2OK) return fmi2Error;
    if (check_place(instance, size, "the size") != fmi2OK) return fmi2Error;
    for (int i = 0; i < N_PARTS; i++) {
        size_t own = 0;
        if (size_of_part(instance, FMUstate, i, &own) != fmi2OK) return failed(instance);
        all += sizeof(uint64_t) + own;
    }
    *size = all;
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                 size_t size) {
    Instance *instance = c;
    const State *state = FMUstate;
    size_t needed = 0;
    if (fmi2SerializedFMUstateSize(c, FMUstate, &needed) != fmi2OK) return fmi2Error;
    if (check_place(instance, serializedState, "the bytes") != fmi2OK) return fmi2Error;
    if (size < needed)
        return report(instance, fmi2Error, "a state needs %u bytes, not %u.", (unsigned)needed, (unsigned)size);
    char *next = serializedState;
    memcpy(next, &state->memory, sizeof state->memory);
    next += sizeof state->memory;
    for (int i = 0; i < N_PARTS; i++) {
        size_t own = 0;
        if (size_of_part(instance, state, i, &own) != fmi2OK) return failed(instance);
        const uint64_t written = own;
        memcpy(next, &written, sizeof written);
        next += sizeof written;
        const fmi2Status status =
            CALL(instance, i, SerializeFMUstate)(instance->parts[i], state->parts[i], next, own);
        if (is_bad(status)) return blame(instance, i, "fmi2SerializeFMUstate", status);
        next += own;
    }
    const uint64_t hash = checksum((const unsigned char *)serializedState, needed - sizeof hash);
    memcpy(next, &hash, sizeof hash);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    Instance *instance = c;
    uint64_t hash = 0;
    if (check_place(instance, serializedState, "the bytes") != fmi2OK) return fmi2Error;
    if (check_place(instance, FMUstate, "the state") != fmi2OK) return fmi2Error;
    if (size < sizeof(Memory) + sizeof hash || memcmp(serializedState, MODEL_GUID, GUID_SIZE) != 0)
        return report(instance, fmi2Error, "these %u bytes are not a state of %s %s.", (unsigned)size,
                      MODEL_IDENTIFIER, MODEL_GUID);
    memcpy(&hash, serializedState + size - sizeof hash, sizeof hash);
    if (hash != checksum((const unsigned char *)serializedState, size - sizeof hash))
        return report(instance, fmi2Error, "the serialized state is damaged.");
    State *state = calloc(1, sizeof *state);
    if (state == NULL) return report(instance, fmi2Error, "out of memory.");
    const char *next = serializedState, *end = serializedState + size - sizeof hash;
    memcpy(&state->memory, next, sizeof state->memory);
    next += sizeof state->memory;
    for (int i = 0; i < N_PARTS; i++) {
        uint64_t own = 0;
        fmi2Status status = fmi2Error;
        if ((size_t)(end - next) >= sizeof own) {
            memcpy(&own, next, sizeof own);
            next += sizeof own;
            if ((uint64_t)(end - next) >= own) {
                status = CALL(instance, i, DeSerializeFMUstate)(instance->parts[i], next, (size_t)own,
                                                                &state->parts[i]);
                next += own;
            }
        }
        if (!is_bad(status)) continue;
        fmi2FMUstate whole = state;
        fmi2FreeFMUstate(instance, &whole);
        return report(instance, fmi2Error, "the serialized state of %s is refused.", parts[i].name);
    }
    fmi2FreeFMUstate(instance, FMUstate);
    *FMUstate = state;
    return fmi2OK;
}

#else

static fmi2Status no_bytes(fmi2Component c) {
    return report(c, fmi2Error, "not all FMUs in this system can serialize their state.");
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    return (void)FMUstate, (void)size, no_bytes(c);
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                 size_t size) {
    return (void)FMUstate, (void)serializedState, (void)size, no_bytes(c);
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    return (void)serializedState, (void)size, (void)FMUstate, no_bytes(c);
}

#endif
