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

/* A type that no variable has: every reference is refused. */
#define NEITHER_GET_NOR_SET(Name, Type)                                                                     \
    fmi3Status fmi3Get##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, Type values[],      \
                             size_t n) {                                                                    \
        return prepare_get(c, vr, nvr, '-', values, n);                                                     \
    }                                                                                                       \
    fmi3Status fmi3Set##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const Type values[], \
                             size_t n) {                                                                    \
        return prepare_set(c, vr, nvr, '-', values, n);                                                     \
    }

GET_AND_SET(Float64, fmi3Float64, 'R', AS_IT_IS, AS_IT_IS)
GET_AND_SET(Int32, fmi3Int32, 'I', AS_INTEGER, AS_DOUBLE)
GET_AND_SET(Int64, fmi3Int64, 'E', AS_INTEGER, AS_DOUBLE)
GET_AND_SET(Boolean, fmi3Boolean, 'B', AS_BOOLEAN, AS_TRUTH)
NEITHER_GET_NOR_SET(Float32, fmi3Float32)
NEITHER_GET_NOR_SET(Int8, fmi3Int8)
NEITHER_GET_NOR_SET(UInt8, fmi3UInt8)
NEITHER_GET_NOR_SET(Int16, fmi3Int16)
NEITHER_GET_NOR_SET(UInt16, fmi3UInt16)
NEITHER_GET_NOR_SET(UInt32, fmi3UInt32)
NEITHER_GET_NOR_SET(UInt64, fmi3UInt64)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, size_t sizes[],
                         fmi3Binary values[], size_t n) {
    (void)sizes;
    return prepare_get(c, vr, nvr, '-', values, n);
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const size_t sizes[],
                         const fmi3Binary values[], size_t n) {
    (void)sizes;
    return prepare_set(c, vr, nvr, '-', values, n);
}

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
    const Status status = do_step(c, currentCommunicationPoint, communicationStepSize);
    *eventHandlingNeeded = fmi3False;
    *terminateSimulation = has_ended(c) ? fmi3True : fmi3False;
    *earlyReturn = fmi3False;
    *lastSuccessfulTime = reached_time(c);
    return status;
}

/* ---- what this FMU has not -------------------------------------------------------------- */

static fmi3Status lacks(fmi3Instance c, const char *what) {
    return report(c, StatusError, "this FMU has no %s.", what);
}

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

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { return lacks(c, "structural parameters"); }

fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { return lacks(c, "structural parameters"); }

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

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time) {
    (void)clock, (void)time;
    return lacks(c, "scheduled execution");
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

#define NO_MODEL_EXCHANGE(Name)                                              \
    fmi3Status fmi3##Name(fmi3Instance c, fmi3Float64 values[], size_t n) { \
        return (void)values, (void)n, lacks(c, "Model Exchange");            \
    }

NO_MODEL_EXCHANGE(GetContinuousStates)
NO_MODEL_EXCHANGE(GetContinuousStateDerivatives)
NO_MODEL_EXCHANGE(GetNominalsOfContinuousStates)
NO_MODEL_EXCHANGE(GetEventIndicators)

#define NONE_OF(Name)                                        \
    fmi3Status fmi3GetNumberOf##Name(fmi3Instance c, size_t *n) { \
        return (void)n, lacks(c, "Model Exchange");          \
    }

NONE_OF(ContinuousStates)
NONE_OF(EventIndicators)

/* A call for no clocks is no error. */
static fmi3Status refuse_clocks(fmi3Instance c, size_t nvr) { return nvr == 0 ? StatusOK : lacks(c, "clocks"); }

#define NO_CLOCKS_1(Name, A)                                                                  \
    fmi3Status fmi3##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, A a[]) { \
        return (void)vr, (void)a, refuse_clocks(c, nvr);                                      \
    }
#define NO_CLOCKS_2(Name, A, B)                                                                      \
    fmi3Status fmi3##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, A a[], B b[]) { \
        return (void)vr, (void)a, (void)b, refuse_clocks(c, nvr);                                    \
    }

NO_CLOCKS_1(GetClock, fmi3Clock)
NO_CLOCKS_1(SetClock, const fmi3Clock)
NO_CLOCKS_2(GetIntervalDecimal, fmi3Float64, fmi3IntervalQualifier)
NO_CLOCKS_1(GetShiftDecimal, fmi3Float64)
NO_CLOCKS_2(GetShiftFraction, fmi3UInt64, fmi3UInt64)
NO_CLOCKS_1(SetIntervalDecimal, const fmi3Float64)
NO_CLOCKS_2(SetIntervalFraction, const fmi3UInt64, const fmi3UInt64)
NO_CLOCKS_1(SetShiftDecimal, const fmi3Float64)
NO_CLOCKS_2(SetShiftFraction, const fmi3UInt64, const fmi3UInt64)

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]) {
    return (void)vr, (void)counters, (void)resolutions, (void)qualifiers, refuse_clocks(c, nvr);
}
