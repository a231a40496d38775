/* The functions of FMI 2.0 that FMI 3.0 has not, or with other arguments. */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

Handle fmi2Instantiate(String instanceName, fmi2Type fmuType, String fmuGUID, String fmuResourceLocation,
                       const fmi2CallbackFunctions *functions, Boolean visible, Boolean loggingOn) {
    (void)visible;
    return create_instance(instanceName, fmuGUID, fmuResourceLocation, (int)fmuType, loggingOn,
                           functions != NULL ? functions->logger : NULL,
                           functions != NULL ? functions->componentEnvironment : NULL);
}

Status fmi2SetupExperiment(Handle c, Boolean toleranceDefined, double tolerance, double startTime,
                           Boolean stopTimeDefined, double stopTime) {
    if (require(c, INSTANTIATED, "set up the experiment") != StatusOK) return StatusError;
    return set_experiment(c, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime);
}

Status fmi2EnterInitializationMode(Handle c) {
    Instance *instance = c;
    if (require(instance, INSTANTIATED, "enter initialization mode") != StatusOK) return StatusError;
    instance->now.phase = INITIALIZATION;
    return StatusOK;
}

GET_AND_SET(Real, fmi2Real, 'R', AS_IT_IS, AS_IT_IS)
GET_AND_SET(Integer, fmi2Integer, 'I', AS_INTEGER, AS_DOUBLE)
GET_AND_SET(Boolean, fmi2Boolean, 'B', AS_BOOLEAN, AS_TRUTH)
NEITHER_GET_NOR_SET(String, fmi2String)

/* Input derivatives apply during the next step only; afterwards an input keeps the value that it has
 * reached.
 */
Status fmi2SetRealInputDerivatives(Handle c, const ValueReference vr[], size_t nvr,
                                       const Integer order[], const double value[]) {
    Instance *instance = c;
    const int phases = INSTANTIATED | INITIALIZATION | STEP;
    if (require_co_simulation(instance, phases, "set input derivatives") != StatusOK) return StatusError;
    if (check_arrays(instance, nvr, vr, value) != StatusOK) return StatusError;
    if (check_arrays(instance, nvr, order, value) != StatusOK) return StatusError;
    for (size_t i = 0; i < nvr; i++) {
        if (check_type(instance, vr[i], 'R') != StatusOK) return StatusError;
        const char *name = variables[vr[i]].name;
        if ((int)vr[i] >= N_INPUTS) return report(instance, StatusError, "%s is not an input.", name);
        if (order[i] < 1 || order[i] > INPUT_ORDERS)
            return report(instance, StatusError, "%s: the order %d of the derivative is not 1 to %d.", name,
                          (int)order[i], INPUT_ORDERS);
    }
#if N_INPUTS > 0
    for (size_t i = 0; i < nvr; i++) {
        instance->now.input_derivatives[vr[i]][order[i] - 1] = value[i];
        instance->now.inputs_move |= value[i] != 0.0;
    }
#endif
    return StatusOK;
}

Status fmi2DoStep(Handle c, double currentCommunicationPoint, double communicationStepSize,
                  Boolean noSetFMUStatePriorToCurrentPoint) {
    return do_step(c, currentCommunicationPoint, communicationStepSize, noSetFMUStatePriorToCurrentPoint);
}

#include "fmi2_status.h"

#ifdef MODEL_EXCHANGE
Status fmi2NewDiscreteStates(Handle c, fmi2EventInfo *info) {
    Instance *instance = c;
    if (require(instance, EVENT, "find new discrete states") != StatusOK) return StatusError;
    if (check_place(instance, info, "the event information") != StatusOK) return StatusError;
    memset(info, 0, sizeof *info); /* no changes, no events */
    return StatusOK;
}
#endif
