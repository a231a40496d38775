/* An FMI 2.0 co-simulation FMU that misbehaves as its parameter `fault` says, from the time `at` on.
 *
 * Calls that the standard forbids it refuses with fmi2Error and a message. Besides the functions
 * of FMI it exports counts over all instances since the library was loaded:
 *
 *     faulty_instances            instances made and not freed
 *     faulty_states               FMU states made and not freed
 *     faulty_rollbacks            how often a state was set
 *     faulty_calls_after_fatal    calls of anything but fmi2FreeInstance after fmi2Fatal
 *
 * This is the only file to compile.
 */
#include "instance.h"
#include "model.h"
#include "states.h"

FMI2_Export int faulty_instances(void);
FMI2_Export int faulty_states(void);
FMI2_Export int faulty_rollbacks(void);
FMI2_Export int faulty_calls_after_fatal(void);

int faulty_instances(void) { return instances; }
int faulty_states(void) { return states; }
int faulty_rollbacks(void) { return rollbacks; }
int faulty_calls_after_fatal(void) { return calls_after_fatal; }

/* ---- instances ------------------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    Instance *instance = calloc(1, sizeof *instance);
    char *name = malloc(strlen(instanceName) + 1);
    (void)fmuResourceLocation, (void)visible;
    if (instance == NULL || name == NULL) {
        free(instance);
        free(name);
        return NULL;
    }
    instance->name = strcpy(name, instanceName);
    instance->logger = functions->logger;
    instance->environment = functions->componentEnvironment;
    instance->logging = loggingOn;
    instance->serial = ++born;
    instances++;
    fmi2Reset(instance);
    if (fmuType == fmi2CoSimulation && strcmp(fmuGUID, MODEL_GUID) == 0) return instance;
    say(instance, fmi2Error, "the faulty model is for co-simulation and has the GUID " MODEL_GUID ".");
    fmi2FreeInstance(instance);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *instance = c;
    if (instance == NULL) return;
    maybe_die(&instance->now, SEGFAULT_FREE);
    instances--;
    free(instance->name);
    free(instance);
}

/* Events are all that can be switched off, whatever the categories. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[]) {
    Instance *instance = c;
    (void)nCategories, (void)categories;
    ALIVE(instance);
    instance->logging = loggingOn;
    return fmi2OK;
}

/* ---- initialize, terminate, reset ------------------------------------------------------ */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *instance = c;
    (void)toleranceDefined, (void)tolerance, (void)stopTimeDefined, (void)stopTime;
    ALIVE(instance);
    if (require(instance, INSTANTIATED, "set up the experiment") != fmi2OK) return fmi2Error;
    instance->now.time = startTime;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *instance = c;
    ALIVE(instance);
    if (require(instance, INSTANTIATED, "enter initialization mode") != fmi2OK) return fmi2Error;
    if (instance->now.fault == ENTER_INITIALIZATION)
        return REFUSE(instance, TOLD "not to enter initialization mode.");
    instance->now.phase = INITIALIZATION;
    evaluate_outputs(&instance->now);
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Instance *instance = c;
    ALIVE(instance);
    if (require(instance, INITIALIZATION, "exit initialization mode") != fmi2OK) return fmi2Error;
    maybe_die(&instance->now, SEGFAULT_INITIALIZATION);
    if (instance->now.fault == EXIT_INITIALIZATION)
        return REFUSE(instance, TOLD "not to exit initialization mode.");
    instance->now.phase = STEP;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
    Instance *instance = c;
    ALIVE(instance);
    if (require(instance, STEP, "terminate") != fmi2OK) return fmi2Error;
    maybe_die(&instance->now, SEGFAULT_TERMINATE);
    while (instance->now.fault == HANG_TERMINATE) hung++;
    instance->now.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    Instance *instance = c;
    ALIVE(instance);
    set_start_values(&instance->now);
    instance->terminates = 0;
    instance->step_status = fmi2OK;
    instance->no_return_before = -HUGE_VAL;
    return fmi2OK;
}

/* ---- get and set ----------------------------------------------------------------------- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    Instance *instance = c;
    ALIVE(instance);
    if (has_fault(&instance->now, SEGFAULT_GET_REAL, instance->now.time)) raise(SIGSEGV);
    if (has_fault(&instance->now, GET_REAL, instance->now.time))
        return REFUSE(instance, TOLD "to refuse getting values at t = %.9g s.", instance->now.time);
    for (size_t i = 0; i < nvr; i++)
        if (vr[i] >= N_REALS) return REFUSE(instance, "there is no Real variable %u.", vr[i]);
    for (size_t i = 0; i < nvr; i++) value[i] = instance->now.reals[vr[i]];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    Instance *instance = c;
    State *now = &instance->now;
    ALIVE(instance);
    if (require(instance, INSTANTIATED | INITIALIZATION | STEP, "set values") != fmi2OK) return fmi2Error;
    if (has_fault(now, SET_REAL, now->time))
        return REFUSE(instance, TOLD "to refuse setting values at t = %.9g s.", now->time);
    for (size_t i = 0; i < nvr; i++)
        if (vr[i] != U && (vr[i] >= Y || now->phase == STEP))
            return REFUSE(instance, "the Real variable %u cannot be set now.", vr[i]);
    for (size_t i = 0; i < nvr; i++) now->reals[vr[i]] = value[i];
    if (now->phase == INITIALIZATION) evaluate_outputs(now);
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    Instance *instance = c;
    ALIVE(instance);
    for (size_t i = 0; i < nvr; i++) {
        if (vr[i] != FAULT) return REFUSE(instance, "there is no Integer variable %u.", vr[i]);
        value[i] = instance->now.fault;
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Integer value[]) {
    Instance *instance = c;
    State *now = &instance->now;
    ALIVE(instance);
    if (require(instance, INSTANTIATED | INITIALIZATION, "set the fault") != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        if (vr[i] != FAULT) return REFUSE(instance, "there is no Integer variable %u.", vr[i]);
        if (value[i] < 0 || value[i] >= N_FAULTS) return REFUSE(instance, "there is no fault %d.", value[i]);
        now->fault = value[i];
    }
    if (now->phase == INITIALIZATION) evaluate_outputs(now);
    return fmi2OK;
}

/* ---- steps ----------------------------------------------------------------------------- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    Instance *instance = c;
    ALIVE(instance);
    if (!INTERPOLATE) return REFUSE(instance, "the faulty model cannot interpolate inputs.");
    if (require(instance, INSTANTIATED | INITIALIZATION | STEP, "set input derivatives") != fmi2OK)
        return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        if (vr[i] != U || order[i] != 1) return REFUSE(instance, "only u has a derivative, of order 1.");
        instance->now.u_rate = value[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    Instance *instance = c;
    ALIVE(instance);
    if (require(instance, STEP, "do a step") != fmi2OK) return fmi2Error;
    instance->terminates = 0;
    instance->step_status = do_step(instance, currentCommunicationPoint, communicationStepSize);
    if (instance->step_status <= fmi2Warning && noSetFMUStatePriorToCurrentPoint)
        instance->no_return_before = currentCommunicationPoint;
    return instance->step_status;
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    Instance *instance = c;
    ALIVE(instance);
    if (instance->step_status != fmi2Pending) return REFUSE(instance, "no step is pending.");
    instance->step_status = fmi2Discard;
    return fmi2OK;
}

/* The status of the last step; a pending one stays so until it is cancelled. */
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
    Instance *instance = c;
    ALIVE(instance);
    if (s != fmi2DoStepStatus) return fmi2Discard;
    *value = instance->step_status;
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    Instance *instance = c;
    ALIVE(instance);
    if (s != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = instance->now.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    Instance *instance = c;
    ALIVE(instance);
    if (s != fmi2Terminated) return fmi2Discard;
    *value = instance->terminates ? fmi2True : fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    Instance *instance = c;
    ALIVE(instance);
    if (s != fmi2PendingStatus) return fmi2Discard;
    *value = "";
    return fmi2OK;
}

/* ---- what this FMU does not have ------------------------------------------------------- */

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    (void)s, (void)value;
    ALIVE((Instance *)c);
    return fmi2Discard;
}

static fmi2Status without(Instance *instance, size_t n, const char *what) {
    return n == 0 ? fmi2OK : REFUSE(instance, "the faulty model has no %s.", what);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    (void)vr, (void)value;
    ALIVE((Instance *)c);
    return without(c, nvr, "Boolean variables");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Boolean value[]) {
    (void)vr, (void)value;
    ALIVE((Instance *)c);
    return without(c, nvr, "Boolean variables");
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
    (void)vr, (void)value;
    ALIVE((Instance *)c);
    return without(c, nvr, "String variables");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[]) {
    (void)vr, (void)value;
    ALIVE((Instance *)c);
    return without(c, nvr, "String variables");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)order, (void)value;
    ALIVE((Instance *)c);
    return without(c, nvr, "output derivatives");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                        size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                        size_t nKnown, const fmi2Real dvKnown[], fmi2Real dvUnknown[]) {
    (void)vUnknown_ref, (void)vKnown_ref, (void)nKnown, (void)dvKnown, (void)dvUnknown;
    ALIVE((Instance *)c);
    return without(c, nUnknown, "directional derivatives");
}
