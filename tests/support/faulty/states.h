/* The FMU state: saved, restored, serialized. */
#ifndef STATES_H
#define STATES_H

#include "model.h"

#define HAS_STATES(instance) \
    if (!ROLLBACK) return REFUSE((instance), "%s called, but the faulty model has no states.", __func__)

static fmi2Status copy_state(Instance *instance, const void *source, fmi2FMUstate *target) {
    if (*target == NULL) {
        if ((*target = malloc(sizeof(State))) == NULL) return REFUSE(instance, "out of memory.");
        states++;
    }
    memcpy(*target, source, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    Instance *instance = c;
    ALIVE(instance);
    HAS_STATES(instance);
    if (has_fault(&instance->now, GET_STATE, instance->now.time))
        return REFUSE(instance, TOLD "to refuse its state at t = %.9g s.", instance->now.time);
    return copy_state(instance, &instance->now, FMUstate);
}

/* Going back further than the host promised is an error. */
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    Instance *instance = c;
    const State *state = FMUstate;
    ALIVE(instance);
    HAS_STATES(instance);
    if (state == NULL) return REFUSE(instance, "there is no state to set.");
    if (state->time < instance->no_return_before)
        return REFUSE(instance,
                      "set back to t = %.9g s, though noSetFMUStatePriorToCurrentPoint was given "
                      "at t = %.9g s.",
                      state->time, instance->no_return_before);
    memcpy(&instance->now, state, sizeof(State));
    rollbacks++;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    Instance *instance = c;
    ALIVE(instance);
    HAS_STATES(instance);
    if (FMUstate == NULL || *FMUstate == NULL) return fmi2OK;
    free(*FMUstate);
    *FMUstate = NULL;
    states--;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    Instance *instance = c;
    ALIVE(instance);
    HAS_STATES(instance);
    if (FMUstate == NULL) return REFUSE(instance, "there is no state to serialize.");
    *size = sizeof(State);
    if (has_fault(&instance->now, HUGE_STATE, instance->now.time)) *size = (size_t)1 << 60;
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                 size_t size) {
    Instance *instance = c;
    ALIVE(instance);
    HAS_STATES(instance);
    if (FMUstate == NULL || size < sizeof(State)) return REFUSE(instance, "there is no state, or no room.");
    memcpy(serializedState, FMUstate, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    Instance *instance = c;
    ALIVE(instance);
    HAS_STATES(instance);
    if (size != sizeof(State)) return REFUSE(instance, "%u bytes are no state.", (unsigned)size);
    return copy_state(instance, serializedState, FMUstate);
}

#endif
