/* FMI 2.0 for co-simulation around the generated equations of one block.
 *
 * guid.h, model.h and equations.c are generated. All values of an instance are one array of doubles,
 * indexed by value reference: inputs, parameters, states, discrete states, outputs. The
 * arithmetic repeats fmublock/instance.py operation by operation, so that both give the same
 * bits; compile without floating-point contraction.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#include "guid.h"
#include "model.h"

#define CASADI_SYMBOL_EXPORT static
#include "equations.c"

#define FIRST_STATE (N_INPUTS + N_PARAMETERS)
#define FIRST_DISCRETE_STATE (FIRST_STATE + N_STATES)
#define FIRST_OUTPUT (FIRST_DISCRETE_STATE + N_DISCRETE_STATES)
#define N_VALUES (FIRST_OUTPUT + N_OUTPUTS)
#define N_EVOLVING (N_VALUES - FIRST_STATE)
#define ROOM(n) ((n) > 0 ? (n) : 1) /* C has no empty arrays */

#define STEP_TOLERANCE 1e-3
#define MAXIMUM_SUBSTEPS 1e9
#define MESSAGE_LENGTH 512

typedef enum { INSTANTIATED = 0, INITIALIZATION = 1, STEP = 2, TERMINATED = 3 } Phase;

/* Everything that evolves or was set; begins with the GUID so that a foreign one is recognized. */
typedef struct {
    char guid[sizeof MODEL_GUID];
    int phase;
    double time;
    double values[ROOM(N_VALUES)];
} State;

typedef struct {
    State now;
    char *name;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    fmi2Boolean logging;
} Instance;

/* ---- equations ------------------------------------------------------------------------- */

typedef int Equations(const casadi_real **, casadi_real **, casadi_int *, casadi_real *, int);

static void evaluate(Equations *equations, double time, const double *values, double *result) {
    const double *arguments[2] = {&time, values};
    double *results[1] = {result};
    equations(arguments, results, NULL, NULL, 0);
}

static void set_states(double *x, const double *x0, double factor, const double *slope) {
    for (int i = 0; i < N_STATES; i++) x[i] = x0[i] + factor * slope[i];
}

/* Classical Runge-Kutta substeps no longer than the internal step. */
static void integrate(double *values, double time, double step) {
#if N_STATES > 0
    double x0[N_STATES], k1[N_STATES], k2[N_STATES], k3[N_STATES], k4[N_STATES];
    double *x = values + FIRST_STATE;
    double count = ceil(fmin(step / values[INTERNAL_STEP], MAXIMUM_SUBSTEPS) - 1e-9);
    if (!(count >= 1.0)) count = 1.0;
    const double dt = step / count;
    for (long i = 0; i < (long)count; i++) {
        const double t = time + (double)i * dt;
        memcpy(x0, x, sizeof x0);
        evaluate(derivatives, t, values, k1);
        set_states(x, x0, 0.5 * dt, k1);
        evaluate(derivatives, t + 0.5 * dt, values, k2);
        set_states(x, x0, 0.5 * dt, k2);
        evaluate(derivatives, t + 0.5 * dt, values, k3);
        set_states(x, x0, dt, k3);
        evaluate(derivatives, t + dt, values, k4);
        for (int j = 0; j < N_STATES; j++) k1[j] = k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j];
        set_states(x, x0, dt / 6.0, k1);
    }
#else
    (void)values, (void)time, (void)step, (void)set_states;
#endif
}

static void update_discrete_states(State *now) {
    double next[ROOM(N_DISCRETE_STATES)];
    evaluate(update, now->time, now->values, next);
    memcpy(now->values + FIRST_DISCRETE_STATE, next, N_DISCRETE_STATES * sizeof(double));
}

static void evaluate_outputs(State *now) {
    double y[ROOM(N_OUTPUTS)];
    evaluate(outputs, now->time, now->values, y);
    memcpy(now->values + FIRST_OUTPUT, y, N_OUTPUTS * sizeof(double));
}

/* Start values that come from parameters, and the outputs that follow from everything set. */
static void initialize_values(State *now) {
    for (int r = FIRST_STATE; r < FIRST_OUTPUT; r++)
        if (variables[r].start_reference >= 0) now->values[r] = now->values[variables[r].start_reference];
    evaluate_outputs(now);
}

/* ---- messages and checks --------------------------------------------------------------- */

static const char *category(fmi2Status status) {
    switch (status) {
        case fmi2Warning: return "logStatusWarning";
        case fmi2Discard: return "logStatusDiscard";
        case fmi2Error: return "logStatusError";
        case fmi2Fatal: return "logStatusFatal";
        default: return "logAll";
    }
}

/* Log a message and return its status. Only messages above fmi2Warning are not switched off. */
static fmi2Status report(const Instance *instance, fmi2Status status, const char *format, ...) {
    char message[MESSAGE_LENGTH];
    va_list arguments;
    if (instance->logger == NULL || (status <= fmi2Warning && !instance->logging)) return status;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    for (char *c = message; *c; c++)
        if (*c == '%') *c = '#'; /* hosts take the message as a printf format */
    instance->logger(instance->environment, instance->name, status, category(status), message);
    return status;
}

static const char *phase_name(int phase) {
    static const char *const names[] = {"instantiated", "initialization", "step", "terminated"};
    return names[phase];
}

static fmi2Status require(const Instance *instance, Phase phase, const char *action) {
    if (instance->now.phase == (int)phase) return fmi2OK;
    return report(instance, fmi2Error, "%s: cannot %s in phase %s.", instance->name, action,
                  phase_name(instance->now.phase));
}

static fmi2Status check_range(const Instance *instance, int reference) {
    const Variable *variable = &variables[reference];
    const double value = instance->now.values[reference];
    if (variable->minimum <= value && value <= variable->maximum && isfinite(value)) return fmi2OK;
    return report(instance, fmi2Error, "%s: %s = %.9g is outside its range, %.9g to %.9g.",
                  instance->name, variable->name, value, variable->minimum, variable->maximum);
}

static fmi2Status check_reference(const Instance *instance, fmi2ValueReference reference, char type) {
    static const struct { char type; const char *name; } types[] = {
        {'R', "Real"}, {'I', "Integer"}, {'B', "Boolean"}};
    if (reference >= N_VALUES)
        return report(instance, fmi2Error, "%s: there is no variable with value reference %u.",
                      instance->name, reference);
    if (variables[reference].type == type) return fmi2OK;
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (types[i].type == variables[reference].type)
            return report(instance, fmi2Error, "%s: %s is of type %s.", instance->name,
                          variables[reference].name, types[i].name);
    return fmi2Error;
}

static fmi2Status check_settable(const Instance *instance, fmi2ValueReference reference) {
    const Variable *variable = &variables[reference];
    if (reference < N_INPUTS) return fmi2OK;
    if (reference >= FIRST_OUTPUT || variable->start_reference >= 0)
        return report(instance, fmi2Error, "%s: %s is computed by the block and cannot be set.",
                      instance->name, variable->name);
    if (instance->now.phase > INITIALIZATION)
        return report(instance, fmi2Error, "%s: %s cannot be set after initialization.", instance->name,
                      variable->name);
    return fmi2OK;
}

/* ---- inquire and create ---------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

static void set_start_values(State *now) {
    memset(now, 0, sizeof *now);
    memcpy(now->guid, MODEL_GUID, sizeof now->guid);
    now->phase = INSTANTIATED;
    for (int r = 0; r < N_VALUES; r++) now->values[r] = variables[r].start;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    (void)fmuResourceLocation, (void)visible;
    Instance probe = {0};
    probe.name = (char *)(instanceName != NULL && *instanceName ? instanceName : MODEL_IDENTIFIER);
    if (functions != NULL) {
        probe.logger = functions->logger;
        probe.environment = functions->componentEnvironment;
    }
    probe.logging = loggingOn;
    if (fmuType != fmi2CoSimulation) {
        report(&probe, fmi2Error, "%s: this FMU is for co-simulation only.", probe.name);
        return NULL;
    }
    if (fmuGUID == NULL || strcmp(fmuGUID, MODEL_GUID) != 0) {
        report(&probe, fmi2Error, "%s: the GUID %s is not this FMU's, %s.", probe.name,
               fmuGUID == NULL ? "(none)" : fmuGUID, MODEL_GUID);
        return NULL;
    }
    Instance *instance = malloc(sizeof *instance);
    char *name = malloc(strlen(probe.name) + 1);
    if (instance == NULL || name == NULL) {
        free(instance);
        free(name);
        report(&probe, fmi2Error, "%s: out of memory.", probe.name);
        return NULL;
    }
    *instance = probe;
    instance->name = strcpy(name, probe.name);
    set_start_values(&instance->now);
    return instance;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *instance = c;
    if (instance == NULL) return;
    free(instance->name);
    free(instance);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[]) {
    (void)nCategories, (void)categories;
    ((Instance *)c)->logging = loggingOn;
    return fmi2OK;
}

/* ---- initialize, terminate, reset ------------------------------------------------------ */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    Instance *instance = c;
    (void)toleranceDefined, (void)tolerance, (void)stopTimeDefined, (void)stopTime;
    if (require(instance, INSTANTIATED, "set up the experiment") != fmi2OK) return fmi2Error;
    if (!isfinite(startTime))
        return report(instance, fmi2Error, "%s: the start time %g is not a finite number of seconds.",
                      instance->name, startTime);
    instance->now.time = startTime;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, INSTANTIATED, "enter initialization mode") != fmi2OK) return fmi2Error;
    instance->now.phase = INITIALIZATION;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, INITIALIZATION, "exit initialization mode") != fmi2OK) return fmi2Error;
    initialize_values(&instance->now);
    for (int r = N_INPUTS; r < FIRST_DISCRETE_STATE; r++)
        if (check_range(instance, r) != fmi2OK) return fmi2Error;
    instance->now.phase = STEP;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, STEP, "terminate") != fmi2OK) return fmi2Error;
    instance->now.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    set_start_values(&((Instance *)c)->now);
    return fmi2OK;
}

/* ---- get and set ----------------------------------------------------------------------- */

/* Check all references of a call, so that a refused call changes nothing. */
static fmi2Status check_call(Instance *instance, const fmi2ValueReference vr[], size_t nvr, char type,
                             int setting) {
    for (size_t i = 0; i < nvr; i++) {
        if (check_reference(instance, vr[i], type) != fmi2OK) return fmi2Error;
        if (setting && check_settable(instance, vr[i]) != fmi2OK) return fmi2Error;
    }
    if (!setting && nvr > 0 && instance->now.phase <= INITIALIZATION) initialize_values(&instance->now);
    return fmi2OK;
}

#define GET_AND_SET(Name, Type, letter, from_double, to_double)                                         \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, Type value[]) { \
        Instance *instance = c;                                                                         \
        if (check_call(instance, vr, nvr, letter, 0) != fmi2OK) return fmi2Error;                       \
        for (size_t i = 0; i < nvr; i++) value[i] = from_double(instance->now.values[vr[i]]);           \
        return fmi2OK;                                                                                  \
    }                                                                                                   \
    fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,                \
                             const Type value[]) {                                                      \
        Instance *instance = c;                                                                         \
        if (check_call(instance, vr, nvr, letter, 1) != fmi2OK) return fmi2Error;                       \
        for (size_t i = 0; i < nvr; i++) instance->now.values[vr[i]] = to_double(value[i]);             \
        return fmi2OK;                                                                                  \
    }

#define AS_IT_IS(x) (x)
#define AS_INTEGER(x) ((fmi2Integer)(x))
#define AS_BOOLEAN(x) ((x) != 0.0 ? fmi2True : fmi2False)
#define AS_DOUBLE(x) ((double)(x))
#define AS_TRUTH(x) ((x) != fmi2False ? 1.0 : 0.0)

GET_AND_SET(Real, fmi2Real, 'R', AS_IT_IS, AS_IT_IS)
GET_AND_SET(Integer, fmi2Integer, 'I', AS_INTEGER, AS_DOUBLE)
GET_AND_SET(Boolean, fmi2Boolean, 'B', AS_BOOLEAN, AS_TRUTH)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
    (void)value;
    return check_call(c, vr, nvr, 'S', 0);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[]) {
    (void)value;
    return check_call(c, vr, nvr, 'S', 1);
}

/* ---- FMU state ------------------------------------------------------------------------- */

static fmi2Status check_state(const Instance *instance, const State *state) {
    if (state == NULL || memcmp(state->guid, MODEL_GUID, sizeof state->guid) != 0)
        return report(instance, fmi2Error, "%s: this is not a state of %s.", instance->name,
                      MODEL_IDENTIFIER " " MODEL_GUID);
    return fmi2OK;
}

static fmi2Status copy_state(const Instance *instance, const State *source, fmi2FMUstate *target) {
    if (*target == NULL) *target = malloc(sizeof(State));
    if (*target == NULL) return report(instance, fmi2Error, "%s: out of memory.", instance->name);
    memcpy(*target, source, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    Instance *instance = c;
    return copy_state(instance, &instance->now, FMUstate);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    Instance *instance = c;
    if (check_state(instance, FMUstate) != fmi2OK) return fmi2Error;
    instance->now = *(State *)FMUstate;
    return fmi2OK;
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
    *size = sizeof(State);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                 size_t size) {
    if (check_state(c, FMUstate) != fmi2OK) return fmi2Error;
    if (size < sizeof(State))
        return report(c, fmi2Error, "%s: a state needs %u bytes, not %u.", ((Instance *)c)->name,
                      (unsigned)sizeof(State), (unsigned)size);
    memcpy(serializedState, FMUstate, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    State state;
    if (size != sizeof state)
        return report(c, fmi2Error, "%s: a state has %u bytes, not %u.", ((Instance *)c)->name,
                      (unsigned)sizeof state, (unsigned)size);
    memcpy(&state, serializedState, sizeof state);
    if (check_state(c, &state) != fmi2OK) return fmi2Error;
    if (state.phase < INSTANTIATED || state.phase > TERMINATED)
        return report(c, fmi2Error, "%s: the serialized state is damaged.", ((Instance *)c)->name);
    return copy_state(c, &state, FMUstate);
}

/* ---- step ------------------------------------------------------------------------------ */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    Instance *instance = c;
    State *now = &instance->now;
    const double time = currentCommunicationPoint, step = communicationStepSize, start = now->time;
    double before[ROOM(N_EVOLVING)];
    (void)noSetFMUStatePriorToCurrentPoint;
    if (require(instance, STEP, "do a step") != fmi2OK) return fmi2Error;
    if (!(isfinite(step) && step > 0.0))
        return report(instance, fmi2Error, "%s: the step size %g s is not a positive number.",
                      instance->name, step);
    if (!(fabs(time - now->time) <= STEP_TOLERANCE * step))
        return report(instance, fmi2Error,
                      "%s: the step starts at t = %.9g s, but the instance is at t = %.9g s.",
                      instance->name, time, now->time);
    memcpy(before, now->values + FIRST_STATE, N_EVOLVING * sizeof(double));
    integrate(now->values, time, step);
    now->time = time + step;
    update_discrete_states(now);
    evaluate_outputs(now);
    for (int r = FIRST_STATE; r < N_VALUES; r++) {
        const double value = now->values[r];
        if (isfinite(value)) continue;
        now->time = start;
        memcpy(now->values + FIRST_STATE, before, N_EVOLVING * sizeof(double));
        return report(instance, fmi2Discard,
                      "%s: step from t = %.9g s with h = %.9g s discarded: %s became %g.", instance->name,
                      time, step, variables[r].name, value);
    }
    return fmi2OK;
}

/* Steps are never asynchronous, so there is nothing to cancel and no pending status. */
fmi2Status fmi2CancelStep(fmi2Component c) {
    return report(c, fmi2Error, "%s: no step is pending.", ((Instance *)c)->name);
}

static fmi2Status no_status(fmi2Component c) {
    return report(c, fmi2Discard, "%s: this status is not available.", ((Instance *)c)->name);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
    (void)s, (void)value;
    return no_status(c);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    if (s != fmi2LastSuccessfulTime) return no_status(c);
    *value = ((Instance *)c)->now.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    (void)s, (void)value;
    return no_status(c);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    if (s != fmi2Terminated) return no_status(c);
    *value = fmi2False; /* the block never ends a run by itself */
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    (void)s, (void)value;
    return no_status(c);
}

/* ---- capabilities that the model description does not claim ---------------------------- */

static fmi2Status unsupported(fmi2Component c, const char *function) {
    return report(c, fmi2Error, "%s: %s is not supported.", ((Instance *)c)->name, function);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                        size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                        size_t nKnown, const fmi2Real dvKnown[], fmi2Real dvUnknown[]) {
    (void)vUnknown_ref, (void)nUnknown, (void)vKnown_ref, (void)nKnown, (void)dvKnown, (void)dvUnknown;
    return unsupported(c, "fmi2GetDirectionalDerivative");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)nvr, (void)order, (void)value;
    return unsupported(c, "fmi2SetRealInputDerivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)nvr, (void)order, (void)value;
    return unsupported(c, "fmi2GetRealOutputDerivatives");
}
