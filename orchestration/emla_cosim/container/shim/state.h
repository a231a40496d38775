/* The FMU state: that of all parts, and of the exchange. */

#ifdef HAS_STATE

typedef struct {
    Memory memory;
    fmi2FMUstate parts[ROOM(N_PARTS)];
} State;

static Status check_state(const Instance *instance, const State *state) {
    if (state != NULL && memcmp(state->memory.guid, MODEL_GUID, GUID_SIZE) == 0) return StatusOK;
    return report(instance, StatusError, "this is not a state of %s %s.", MODEL_IDENTIFIER, MODEL_GUID);
}

Status FMI(FreeFMUState)(Handle c, FmuState *FMUState) {
    Instance *instance = c;
    if (FMUState == NULL || *FMUState == NULL) return StatusOK;
    State *state = *FMUState;
    for (int i = 0; i < N_PARTS && instance->memory.phase != DEAD; i++)
        if (state->parts[i] != NULL) CALL(instance, i, FreeFMUstate, FreeFMUState)(instance->parts[i], &state->parts[i]);
    free(state);
    *FMUState = NULL;
    return StatusOK;
}

Status FMI(GetFMUState)(Handle c, FmuState *FMUState) {
    Instance *instance = c;
    if (require(instance, INSTANTIATED | INITIALIZATION | STEP | TERMINATED, "save the state") != StatusOK)
        return StatusError;
    if (check_place(instance, FMUState, "the state") != StatusOK) return StatusError;
    if (*FMUState != NULL && check_state(instance, *FMUState) != StatusOK) return StatusError;
    const int is_new = *FMUState == NULL;
    State *state = is_new ? calloc(1, sizeof *state) : *FMUState;
    if (state == NULL) return report(instance, StatusError, "out of memory.");
    instance->goes_back = 1;
    use_memory(instance);
    for (int i = 0; i < N_PARTS; i++) {
        const int32_t status = (int32_t)CALL(instance, i, GetFMUstate, GetFMUState)(instance->parts[i], &state->parts[i]);
        if (!is_bad(status)) continue;
        FmuState whole = state;
        if (is_new) FMI(FreeFMUState)(instance, &whole);
        return blame_part(instance, i, "the saving of its state", status);
    }
    state->memory = instance->memory;
    *FMUState = state;
    return StatusOK;
}

Status FMI(SetFMUState)(Handle c, FmuState FMUState) {
    Instance *instance = c;
    const State *state = FMUState;
    if (require(instance, ~DEAD, "restore a state") != StatusOK) return StatusError;
    if (check_state(instance, state) != StatusOK) return StatusError;
    for (int i = 0; i < N_PARTS; i++) {
        const int32_t status = (int32_t)CALL(instance, i, SetFMUstate, SetFMUState)(instance->parts[i], state->parts[i]);
        if (is_bad(status)) return blame_part(instance, i, "the restoring of its state", status);
    }
    instance->memory = state->memory;
    instance->settled = 0;
    use_memory(instance);
    return StatusOK;
}

#else

static Status no_state(Handle c) {
    return report(c, StatusError, "not all FMUs in this system can save their state.");
}

Status FMI(FreeFMUState)(Handle c, FmuState *FMUState) { return (void)FMUState, no_state(c); }
Status FMI(GetFMUState)(Handle c, FmuState *FMUState) { return (void)FMUState, no_state(c); }
Status FMI(SetFMUState)(Handle c, FmuState FMUState) { return (void)FMUState, no_state(c); }

#endif

#ifdef HAS_SERIALIZATION

/* Bytes: the memory, then size and bytes of the state of each part, then a checksum (FNV-1a) of all. */

static uint64_t checksum(const unsigned char *bytes, size_t size) {
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < size; i++) hash = (hash ^ bytes[i]) * 1099511628211u;
    return hash;
}

static Status size_of_part(Instance *instance, const State *state, int i, size_t *size) {
    const int32_t status =
        (int32_t)CALL(instance, i, SerializedFMUstateSize, SerializedFMUStateSize)(instance->parts[i], state->parts[i], size);
    return is_bad(status) ? blame_part(instance, i, "the question for the size of its state", status) : StatusOK;
}

Status FMI(SerializedFMUStateSize)(Handle c, FmuState FMUState, size_t *size) {
    Instance *instance = c;
    size_t all = sizeof(Memory) + sizeof(uint64_t);
    if (check_state(instance, FMUState) != StatusOK) return StatusError;
    if (check_place(instance, size, "the size") != StatusOK) return StatusError;
    for (int i = 0; i < N_PARTS; i++) {
        size_t own = 0;
        if (size_of_part(instance, FMUState, i, &own) != StatusOK) return failed(instance);
        all += sizeof(uint64_t) + own;
    }
    *size = all;
    return StatusOK;
}

Status FMI(SerializeFMUState)(Handle c, FmuState FMUState, Byte serializedState[],
                                 size_t size) {
    Instance *instance = c;
    const State *state = FMUState;
    size_t needed = 0;
    if (FMI(SerializedFMUStateSize)(c, FMUState, &needed) != StatusOK) return StatusError;
    if (check_place(instance, serializedState, "the bytes") != StatusOK) return StatusError;
    if (size < needed)
        return report(instance, StatusError, "a state needs %u bytes, not %u.", (unsigned)needed, (unsigned)size);
    char *next = (char *)serializedState;
    memcpy(next, &state->memory, sizeof state->memory);
    next += sizeof state->memory;
    for (int i = 0; i < N_PARTS; i++) {
        size_t own = 0;
        if (size_of_part(instance, state, i, &own) != StatusOK) return failed(instance);
        const uint64_t written = own;
        memcpy(next, &written, sizeof written);
        next += sizeof written;
        const int32_t status =
            (int32_t)CALL(instance, i, SerializeFMUstate, SerializeFMUState)(instance->parts[i], state->parts[i], next, own);
        if (is_bad(status)) return blame_part(instance, i, "the serializing of its state", status);
        next += own;
    }
    const uint64_t hash = checksum((const unsigned char *)serializedState, needed - sizeof hash);
    memcpy(next, &hash, sizeof hash);
    return StatusOK;
}

Status FMI(DeserializeFMUState)(Handle c, const Byte serializedState[], size_t size,
                                   FmuState *FMUState) {
    Instance *instance = c;
    uint64_t hash = 0;
    if (check_place(instance, serializedState, "the bytes") != StatusOK) return StatusError;
    if (check_place(instance, FMUState, "the state") != StatusOK) return StatusError;
    if (size < sizeof(Memory) + sizeof hash || memcmp(serializedState, MODEL_GUID, GUID_SIZE) != 0)
        return report(instance, StatusError, "these %u bytes are not a state of %s %s.", (unsigned)size,
                      MODEL_IDENTIFIER, MODEL_GUID);
    memcpy(&hash, serializedState + size - sizeof hash, sizeof hash);
    if (hash != checksum((const unsigned char *)serializedState, size - sizeof hash))
        return report(instance, StatusError, "the serialized state is damaged.");
    State *state = calloc(1, sizeof *state);
    if (state == NULL) return report(instance, StatusError, "out of memory.");
    const char *next = (const char *)serializedState, *end = next + size - sizeof hash;
    memcpy(&state->memory, next, sizeof state->memory);
    next += sizeof state->memory;
    for (int i = 0; i < N_PARTS; i++) {
        uint64_t own = 0;
        int32_t status = fmi2Error;
        if ((size_t)(end - next) >= sizeof own) {
            memcpy(&own, next, sizeof own);
            next += sizeof own;
            if ((uint64_t)(end - next) >= own) {
                status = (int32_t)CALL(instance, i, DeSerializeFMUstate, DeserializeFMUState)(instance->parts[i], next, (size_t)own,
                                                                &state->parts[i]);
                next += own;
            }
        }
        if (!is_bad(status)) continue;
        FmuState whole = state;
        FMI(FreeFMUState)(instance, &whole);
        return report(instance, StatusError, "the serialized state of %s is refused.", parts[i].name);
    }
    FMI(FreeFMUState)(instance, FMUState);
    *FMUState = state;
    return StatusOK;
}

#else

static Status no_bytes(Handle c) {
    return report(c, StatusError, "not all FMUs in this system can serialize their state.");
}

Status FMI(SerializedFMUStateSize)(Handle c, FmuState FMUState, size_t *size) {
    return (void)FMUState, (void)size, no_bytes(c);
}
Status FMI(SerializeFMUState)(Handle c, FmuState FMUState, Byte serializedState[],
                                 size_t size) {
    return (void)FMUState, (void)serializedState, (void)size, no_bytes(c);
}
Status FMI(DeserializeFMUState)(Handle c, const Byte serializedState[], size_t size,
                                   FmuState *FMUState) {
    return (void)serializedState, (void)size, (void)FMUState, no_bytes(c);
}

#endif
