/* Functions that co-simulation and Model Exchange share: create, initialize, get and set. */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

/* ---- create and free ------------------------------------------------------------------- */

static fmi2Status check_identity(const Instance *instance, fmi2String name, fmi2Type type, fmi2String guid) {
    if (name == NULL || *name == '\0')
        return report(instance, fmi2Error, "an instance needs a name; this one is %s.",
                      name == NULL ? "NULL" : "empty");
#ifndef MODEL_EXCHANGE
    if (type == fmi2ModelExchange)
        return report(instance, fmi2Error, "this FMU is for co-simulation only.");
#endif
    if (type != fmi2CoSimulation && type != fmi2ModelExchange)
        return report(instance, fmi2Error, "there is no FMU type %d.", (int)type);
    if (guid == NULL || strcmp(guid, GUID(&instance->now)) != 0)
        return report(instance, fmi2Error, "the GUID %.100s is not this FMU's, %s.",
                      guid == NULL ? "(none)" : guid, GUID(&instance->now));
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    (void)visible;
    const char *own_name = instanceName != NULL && *instanceName ? instanceName : MODEL_IDENTIFIER;
    Instance *instance = calloc(1, sizeof *instance);
    char *name = malloc(strlen(own_name) + 1);
    if (instance == NULL || name == NULL) {
        free(instance);
        free(name);
        return NULL;
    }
    instance->name = strcpy(name, own_name);
    instance->logger = functions != NULL ? functions->logger : NULL;
    instance->environment = functions != NULL ? functions->componentEnvironment : NULL;
    instance->logged = loggingOn ? EVERYTHING : PROBLEMS;
    instance->no_return_before = -HUGE_VAL;
    if (open_resource(instance, fmuResourceLocation) == fmi2OK) {
        set_start_values(&instance->now, (int)fmuType);
        if (check_identity(instance, instanceName, fmuType, fmuGUID) == fmi2OK) return instance;
    }
    fmi2FreeInstance(instance);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *instance = c;
    if (instance == NULL) return;
    free((void *)instance->now.resource);
    free(instance->name);
    free(instance);
}

/* ---- logging --------------------------------------------------------------------------- */

#include "logging.h"

/* ---- initialize, terminate, reset ------------------------------------------------------ */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *instance = c;
    if (require(instance, INSTANTIATED, "set up the experiment") != fmi2OK) return fmi2Error;
    if (check_experiment(instance, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime) != fmi2OK)
        return fmi2Error;
    instance->now.time = startTime;
    instance->now.stop_time = stopTimeDefined ? stopTime : HUGE_VAL;
    if (toleranceDefined && instance->now.type == fmi2CoSimulation)
        report(instance, fmi2OK, "tolerance %g ignored; solver.internal_step sets the accuracy.",
               tolerance);
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, INSTANTIATED, "enter initialization mode") != fmi2OK) return fmi2Error;
    instance->now.phase = INITIALIZATION;
    return fmi2OK;
}

/* Check the block's conditions on its values, beside their ranges. */
static fmi2Status check_conditions(const Instance *instance) {
#if N_CONDITIONS > 0
    double holds[N_CONDITIONS];
    conditions(instance->now.time, instance->now.values, FIXED(&instance->now), holds);
    for (int i = 0; i < N_CONDITIONS; i++)
        if (holds[i] == 0.0) return report(instance, fmi2Error, "%s.", demands[i]);
#else
    (void)instance;
#endif
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Instance *instance = c;
    State *now = &instance->now;
    if (require(instance, INITIALIZATION, "exit initialization mode") != fmi2OK) return fmi2Error;
    take_start_values(now);
    for (int r = N_INPUTS; r < FIRST_DISCRETE_STATE; r++)
        if (check_range(instance, r) != fmi2OK) return fmi2Error;
    fix_values(now);
    if (check_conditions(instance) != fmi2OK) return fmi2Error;
    evaluate_outputs(now);
    hold_inputs(now, 0.0);
    now->phase = now->type == fmi2ModelExchange ? EVENT : STEP;
    report_limits(instance);
    return report(instance, fmi2OK, "initialized at t = %.9g s.", now->time);
}

fmi2Status fmi2Terminate(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, RUNNING, "terminate") != fmi2OK) return fmi2Error;
    instance->now.phase = TERMINATED;
    return report(instance, fmi2OK, "terminated at t = %.9g s.", instance->now.time);
}

fmi2Status fmi2Reset(fmi2Component c) {
    Instance *instance = c;
    set_start_values(&instance->now, instance->now.type);
    instance->no_return_before = -HUGE_VAL;
    memset(instance->left, 0, sizeof instance->left);
    instance->ended = 0;
    return fmi2OK;
}

/* ---- get ------------------------------------------------------------------------------- */

/* Bring the requested values up to the present time. */
static void bring_up_to_date(State *now, int derivatives_asked) {
    if (now->phase == INITIALIZATION) initialize_values(now);
    if (now->phase & MODEL_EXCHANGE_RUNNING) evaluate_outputs(now);
    if (derivatives_asked) evaluate_derivatives(now);
}

/* Check all references of a call before reading any value. */
static fmi2Status prepare_get(Instance *instance, const fmi2ValueReference vr[], size_t nvr, char type,
                              const void *value) {
    int derivatives_asked = 0;
    if (require(instance, ~INSTANTIATED, "get values") != fmi2OK) return fmi2Error;
    if (check_arrays(instance, nvr, vr, value) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        if (check_type(instance, vr[i], type) != fmi2OK) return fmi2Error;
        derivatives_asked |= vr[i] >= FIRST_DERIVATIVE;
    }
    if (nvr > 0) bring_up_to_date(&instance->now, derivatives_asked);
    return fmi2OK;
}

/* ---- set ------------------------------------------------------------------------------- */

static fmi2Status check_settable(const Instance *instance, int reference) {
    const Variable *variable = &variables[reference];
    const int phase = instance->now.phase;
    if (variable->access == 'F')
        return report(instance, fmi2Error, "%s is fixed in this FMU and cannot be set.", variable->name);
    if (reference >= FIRST_OUTPUT || variable->start_reference != -1)
        return report(instance, fmi2Error, "%s is computed by the block and cannot be set.", variable->name);
    if (reference >= N_INPUTS && !(phase & (INSTANTIATED | INITIALIZATION)))
        return report(instance, fmi2Error, "%s cannot be set after initialization.", variable->name);
    if (phase == CONTINUOUS_TIME && variable->type != 'R')
        return report(instance, fmi2Error, "%s can be set at events only.", variable->name);
    return fmi2OK;
}

/* Check all references of a call, so that a refused call changes nothing. */
static fmi2Status prepare_set(Instance *instance, const fmi2ValueReference vr[], size_t nvr, char type,
                              const void *value) {
    if (require(instance, ~TERMINATED, "set values") != fmi2OK) return fmi2Error;
    if (check_arrays(instance, nvr, vr, value) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++)
        if (check_type(instance, vr[i], type) != fmi2OK || check_settable(instance, (int)vr[i]) != fmi2OK)
            return fmi2Error;
    return fmi2OK;
}

/* ---- the four types -------------------------------------------------------------------- */

#define GET_AND_SET(Name, Type, letter, from_double, to_double)                                         \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, Type value[]) { \
        Instance *instance = c;                                                                         \
        if (prepare_get(instance, vr, nvr, letter, value) != fmi2OK) return fmi2Error;                  \
        for (size_t i = 0; i < nvr; i++) value[i] = from_double(instance->now.values[vr[i]]);           \
        return fmi2OK;                                                                                  \
    }                                                                                                   \
    fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,                \
                             const Type value[]) {                                                      \
        Instance *instance = c;                                                                         \
        if (prepare_set(instance, vr, nvr, letter, value) != fmi2OK) return fmi2Error;                  \
        for (size_t i = 0; i < nvr; i++) instance->now.values[vr[i]] = to_double(value[i]);             \
        return fmi2OK;                                                                                  \
    }

#include "conversions.h"

GET_AND_SET(Real, fmi2Real, 'R', AS_IT_IS, AS_IT_IS)
GET_AND_SET(Integer, fmi2Integer, 'I', AS_INTEGER, AS_DOUBLE)
GET_AND_SET(Boolean, fmi2Boolean, 'B', AS_BOOLEAN, AS_TRUTH)

/* A block has no strings, so that every reference is refused. */
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
    return prepare_get(c, vr, nvr, 'S', value);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[]) {
    return prepare_set(c, vr, nvr, 'S', value);
}
