/* The functions of FMI 3.0 that FMI 2.0 has not, or with other arguments. */

/* ---- create ---------------------------------------------------------------------------- */

#ifdef _WIN32
static int is_separator(char c) { return c == '/' || c == '\\'; }
#else
static int is_separator(char c) { return c == '/'; }
#endif

/* Return a new text: the file: URI of a folder, without separator at its end. The parts need one. */
static char *uri_of(const char *path) {
    static const char digits[] = "0123456789ABCDEF", plain[] = "-._~:";
    size_t n = strlen(path);
    while (n > 0 && is_separator(path[n - 1])) n--;
    char *uri = malloc(3 * n + sizeof "file:///"), *end = uri;
    if (uri == NULL) return NULL;
    end += sprintf(end, "file://%s", is_separator(*path) ? "" : "/"); /* before C: */
    for (size_t i = 0; i < n; i++) {
        const unsigned char c = (unsigned char)path[i];
        const int is_letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
        if (is_separator(path[i])) {
            *end++ = '/';
        } else if (is_letter || (c != '\0' && strchr(plain, c) != NULL)) {
            *end++ = (char)c;
        } else {
            *end++ = '%';
            *end++ = digits[c / 16];
            *end++ = digits[c % 16];
        }
    }
    *end = '\0';
    return uri;
}

static Handle create(String name, String token, String path, int type, Boolean logging, Environment environment,
                     Logger logger) {
    char *location = path == NULL ? NULL : uri_of(path);
    const Handle made = create_instance(name, token, location, type, logging, logger, environment);
    free(location);
    return made;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage) {
    (void)visible;
    return create(instanceName, instantiationToken, resourcePath, FOR_MODEL_EXCHANGE, loggingOn,
                  instanceEnvironment, logMessage);
}

/* Report what an instance cannot have, and free it; returns NULL. */
static fmi3Instance without(fmi3Instance c, const char *what) {
    if (c == NULL) return NULL;
    report(c, StatusError, "this FMU has no %s.", what);
    fmi3FreeInstance(c);
    return NULL;
}

/* A step ends early for no reason, so that it does not matter whether it may. */
fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate) {
    (void)visible, (void)earlyReturnAllowed, (void)requiredIntermediateVariables, (void)intermediateUpdate;
    const fmi3Instance made = create(instanceName, instantiationToken, resourcePath, FOR_CO_SIMULATION, loggingOn,
                                     instanceEnvironment, logMessage);
    if (eventModeUsed) return without(made, "event mode");
    return nRequiredIntermediateVariables > 0 ? without(made, "intermediate update") : made;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
    fmi3UnlockPreemptionCallback unlockPreemption) {
    (void)visible, (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
    return without(create(instanceName, instantiationToken, resourcePath, FOR_CO_SIMULATION, loggingOn,
                          instanceEnvironment, logMessage),
                   "scheduled execution");
}

/* ---- initialize ------------------------------------------------------------------------ */

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
    if (require(c, INSTANTIATED, "enter initialization mode") != StatusOK) return StatusError;
    if (set_experiment(c, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime) != StatusOK)
        return StatusError;
    return enter_initialization(c);
}

/* ---- the types ------------------------------------------------------------------------- */

#define LETTER_Float32 'r'
#define LETTER_Int8 'b'
#define LETTER_UInt8 'c'
#define LETTER_Int16 's'
#define LETTER_UInt16 't'
#define LETTER_UInt32 'u'
#define LETTER_UInt64 'U'

#define OTHER_TYPE(Name, Type) GET_AND_SET(Name, Type, LETTER_##Name, (Type), AS_DOUBLE)

#include "fmi3_values.h"

/* ---- co-simulation --------------------------------------------------------------------- */

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn,
                      fmi3Float64 *lastSuccessfulTime) {
    (void)noSetFMUStatePriorToCurrentPoint;
    if (check_place(c, eventHandlingNeeded, "eventHandlingNeeded") != StatusOK) return StatusError;
    if (check_place(c, terminateSimulation, "terminateSimulation") != StatusOK) return StatusError;
    if (check_place(c, earlyReturn, "earlyReturn") != StatusOK) return StatusError;
    if (check_place(c, lastSuccessfulTime, "lastSuccessfulTime") != StatusOK) return StatusError;
    const Status status = do_steps(c, currentCommunicationPoint, communicationStepSize);
    *eventHandlingNeeded = fmi3False;
    *terminateSimulation = has_ended(c) ? fmi3True : fmi3False;
    *earlyReturn = fmi3False;
    *lastSuccessfulTime = reached_time(c);
    return status;
}

/* ---- what this FMU has not -------------------------------------------------------------- */

#include "fmi3_lacking.h"

#define DERIVATIVES                                                                                      \
    fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns,                               \
        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,       \
        fmi3Float64 sensitivity[], size_t nSensitivity

fmi3Status fmi3GetDirectionalDerivative(DERIVATIVES) {
    (void)unknowns, (void)nUnknowns, (void)knowns, (void)nKnowns;
    (void)seed, (void)nSeed, (void)sensitivity, (void)nSensitivity;
    return lacks(c, "directional derivatives");
}

fmi3Status fmi3GetAdjointDerivative(DERIVATIVES) {
    (void)unknowns, (void)nUnknowns, (void)knowns, (void)nKnowns;
    (void)seed, (void)nSeed, (void)sensitivity, (void)nSensitivity;
    return lacks(c, "adjoint derivatives");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr,
                                    const fmi3Int32 orders[], fmi3Float64 values[], size_t n) {
    (void)vr, (void)nvr, (void)orders, (void)values, (void)n;
    return lacks(c, "derivatives of outputs");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference reference, size_t *n) {
    (void)reference, (void)n;
    return lacks(c, "dependencies of single elements");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t from[],
                                       fmi3ValueReference independents[], size_t to[], fmi3DependencyKind kinds[],
                                       size_t n) {
    (void)dependent, (void)from, (void)independents, (void)to, (void)kinds, (void)n;
    return lacks(c, "dependencies of single elements");
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) { return lacks(c, "event mode"); }

fmi3Status fmi3EnterStepMode(fmi3Instance c) { return lacks(c, "event mode"); }

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { return lacks(c, "event mode"); }

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *needsUpdate, fmi3Boolean *terminates,
                                    fmi3Boolean *nominalsChanged, fmi3Boolean *valuesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime) {
    (void)needsUpdate, (void)terminates, (void)nominalsChanged, (void)valuesChanged;
    (void)nextEventTimeDefined, (void)nextEventTime;
    return lacks(c, "event mode");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { return lacks(c, "Model Exchange"); }

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint, (void)enterEventMode, (void)terminateSimulation;
    return lacks(c, "Model Exchange");
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) { return (void)time, lacks(c, "Model Exchange"); }

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 states[], size_t n) {
    return (void)states, (void)n, lacks(c, "Model Exchange");
}

#define NO_MODEL_EXCHANGE(Name)                                             \
    fmi3Status fmi3##Name(fmi3Instance c, fmi3Float64 values[], size_t n) { \
        return (void)values, (void)n, lacks(c, "Model Exchange");           \
    }

NO_MODEL_EXCHANGE(GetContinuousStates)
NO_MODEL_EXCHANGE(GetContinuousStateDerivatives)
NO_MODEL_EXCHANGE(GetNominalsOfContinuousStates)
NO_MODEL_EXCHANGE(GetEventIndicators)

#define NONE_OF(Name)                                             \
    fmi3Status fmi3GetNumberOf##Name(fmi3Instance c, size_t *n) { \
        return (void)n, lacks(c, "Model Exchange");               \
    }

NONE_OF(ContinuousStates)
NONE_OF(EventIndicators)
