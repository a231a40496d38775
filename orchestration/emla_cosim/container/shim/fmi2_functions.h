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
    if (require(c, INSTANTIATED, "enter initialization mode") != StatusOK) return StatusError;
    return enter_initialization(c);
}

GET_AND_SET(Real, fmi2Real, 'R', AS_IT_IS, AS_IT_IS)
GET_AND_SET(Integer, fmi2Integer, 'I', AS_INTEGER, AS_DOUBLE)
GET_AND_SET(Boolean, fmi2Boolean, 'B', AS_BOOLEAN, AS_TRUTH)

Status fmi2DoStep(Handle c, double currentCommunicationPoint, double communicationStepSize,
                  Boolean noSetFMUStatePriorToCurrentPoint) {
    (void)noSetFMUStatePriorToCurrentPoint;
    return do_steps(c, currentCommunicationPoint, communicationStepSize);
}

#include "fmi2_status.h"

/* ---- derivatives, which this FMU does not have ------------------------------------------- */

Status fmi2GetDirectionalDerivative(Handle c, const ValueReference unknowns[], size_t nUnknown,
                                    const ValueReference knowns[], size_t nKnown, const fmi2Real known[],
                                    fmi2Real unknown[]) {
    (void)unknowns, (void)nUnknown, (void)knowns, (void)nKnown, (void)known, (void)unknown;
    return report(c, StatusError, "there are no directional derivatives.");
}

Status fmi2SetRealInputDerivatives(Handle c, const ValueReference vr[], size_t nvr, const Integer order[],
                                   const fmi2Real value[]) {
    (void)vr, (void)nvr, (void)order, (void)value;
    return report(c, StatusError, "inputs are held during a step; they have no derivatives.");
}

Status fmi2GetRealOutputDerivatives(Handle c, const ValueReference vr[], size_t nvr, const Integer order[],
                                    fmi2Real value[]) {
    (void)vr, (void)nvr, (void)order, (void)value;
    return report(c, StatusError, "there are no derivatives of outputs.");
}
