/* The functions of FMI 3.0 that FMI 2.0 has not, or with other arguments. */

/* ---- create ---------------------------------------------------------------------------- */

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage) {
    (void)visible;
    return create_instance(instanceName, instantiationToken, resourcePath, FOR_MODEL_EXCHANGE, loggingOn, logMessage,
                           instanceEnvironment);
}

/* A step ends early only if the host asks for it in an intermediate update. */
fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate) {
    (void)visible;
    Instance *instance = create_instance(instanceName, instantiationToken, resourcePath, FOR_CO_SIMULATION,
                                         loggingOn, logMessage, instanceEnvironment);
    if (instance == NULL) return NULL;
#ifdef CLOCK_INTERVAL
    if (!eventModeUsed)
        report(instance, StatusError, "this FMU has a clock, and needs a host with event mode in co-simulation.");
    else
#else
    if (eventModeUsed)
        report(instance, StatusError, "this FMU has no event mode in co-simulation.");
    else
#endif
    if (use_intermediate_update(instance, intermediateUpdate, earlyReturnAllowed, requiredIntermediateVariables,
                                     nRequiredIntermediateVariables) == StatusOK)
        return instance;
    fmi3FreeInstance(instance);
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
    fmi3UnlockPreemptionCallback unlockPreemption) {
    (void)visible, (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
    Instance *instance = create_instance(instanceName, instantiationToken, resourcePath, FOR_CO_SIMULATION,
                                         loggingOn, logMessage, instanceEnvironment);
    if (instance == NULL) return NULL;
    report(instance, StatusError, "this FMU has no scheduled execution.");
    fmi3FreeInstance(instance);
    return NULL;
}

/* ---- initialize ------------------------------------------------------------------------ */

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
    Instance *instance = c;
    if (require(instance, INSTANTIATED, "enter initialization mode") != StatusOK) return fmi3Error;
    if (set_experiment(instance, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime) != StatusOK)
        return fmi3Error;
    instance->now.phase = INITIALIZATION;
    return fmi3OK;
}

/* ---- the types ------------------------------------------------------------------------- */

#include "fmi3_values.h"

NEITHER_GET_NOR_SET(String, fmi3String)

/* ---- dependencies and derivatives ------------------------------------------------------ */

/* Value reference of the variable that has this value: an array's is that of its first element. */
static int variable_of(int value) {
    while (ELEMENTS(value) == 0) value--;
    return value;
}

/* Find the dependencies of a variable's elements; returns their number. The table is in model.h. */
static size_t find_dependencies(ValueReference variable, size_t from[], ValueReference independents[], size_t to[],
                                fmi3DependencyKind kinds[]) {
    size_t n = 0;
    for (int i = 0; i < N_DEPENDENCIES; i++) {
        const int unknown = dependencies[i].unknown, known = dependencies[i].known;
        if (variable_of(unknown) != (int)variable) continue;
        if (from != NULL) {
            const int independent = variable_of(known);
            from[n] = (size_t)(unknown - (int)variable) + 1;
            independents[n] = (ValueReference)independent;
            to[n] = (size_t)(known - independent) + 1;
            kinds[n] = fmi3Dependent;
        }
        n++;
    }
    return n;
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference valueReference,
                                               size_t *nDependencies) {
    if (check_exists(c, valueReference) != StatusOK) return fmi3Error;
    if (check_place(c, nDependencies, "the number") != StatusOK) return fmi3Error;
    *nDependencies = find_dependencies(valueReference, NULL, NULL, NULL, NULL);
    return fmi3OK;
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[],
                                       fmi3DependencyKind dependencyKinds[], size_t nDependencies) {
    if (check_exists(c, dependent) != StatusOK) return fmi3Error;
    const size_t n = find_dependencies(dependent, NULL, NULL, NULL, NULL);
    if (n != nDependencies)
        return report(c, fmi3Error, "%u dependencies were announced, but there are %u.", (unsigned)nDependencies,
                      (unsigned)n);
    if (check_arrays(c, n, elementIndicesOfDependent, independents) != StatusOK) return fmi3Error;
    if (check_arrays(c, n, elementIndicesOfIndependents, dependencyKinds) != StatusOK) return fmi3Error;
    if (n > 0)
        find_dependencies(dependent, elementIndicesOfDependent, independents, elementIndicesOfIndependents,
                          dependencyKinds);
    return fmi3OK;
}

/* The transposed matrix of `fmi3GetDirectionalDerivative`, times the seeds of the unknowns: one tangent of
 * the equations for each known.
 */
fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
    Instance *instance = c;
    double tangents[ROOM(N_VALUES)];
    if (require(instance, ~(INSTANTIATED | INTERMEDIATE_UPDATE), "get adjoint derivatives") != StatusOK) return fmi3Error;
    if (check_arrays(instance, nUnknowns, unknowns, seed) != StatusOK) return fmi3Error;
    if (check_arrays(instance, nKnowns, knowns, sensitivity) != StatusOK) return fmi3Error;
    for (size_t i = 0; i < nUnknowns; i++)
        if (check_unknown(instance, unknowns[i]) != StatusOK) return fmi3Error;
    for (size_t i = 0; i < nKnowns; i++)
        if (check_known(instance, knowns[i]) != StatusOK) return fmi3Error;
    if (check_count(instance, unknowns, nUnknowns, nSeed) != StatusOK) return fmi3Error;
    if (check_count(instance, knowns, nKnowns, nSensitivity) != StatusOK) return fmi3Error;
    for (size_t i = 0, k = 0; i < nKnowns; i++)
        for (int j = 0; j < ELEMENTS(knowns[i]); j++, k++) {
            double direction[ROOM(N_VALUES)] = {0};
            direction[(int)knowns[i] + j] = 1.0;
            tangents_here(&instance->now, direction, tangents);
            sensitivity[k] = 0.0;
            for (size_t u = 0, s = 0; u < nUnknowns; u++)
                for (int e = 0; e < ELEMENTS(unknowns[u]); e++, s++)
                    if (seed[s] != 0.0) sensitivity[k] += seed[s] * tangents[(int)unknowns[u] + e];
        }
    return fmi3OK;
}

/* ---- co-simulation --------------------------------------------------------------------- */

#ifdef CLOCK_INTERVAL
/* A step between two ticks passes time. */
static Status pass_time(Instance *instance, double time, double step, Boolean will_not_go_back) {
    State *now = &instance->now;
    const double end = time + step, begin = now->time;
    if (require(instance, STEP, "do a step") != StatusOK) return StatusError;
    if (check_step(instance, time, step) != StatusOK) return StatusError;
    if (end > next_tick(now) && !is_tick(now, end))
        return report(instance, StatusError, "the step to t = %.9g s goes past the tick of the clock at t = %.9g s.",
                      end, next_tick(now));
    now->time = is_tick(now, end) ? next_tick(now) : end;
    return end_step(instance, begin, will_not_go_back);
}
#define DO_STEP pass_time
#else
#define DO_STEP do_step
#endif

/* Check the pointers to the results of a step. This is one function, because compilers expect each check to fail as
 * often as not: after four of them `fmi3DoStep` would be taken for rare, and the step for not worth inlining.
 */
static Status check_results(const Instance *instance, const fmi3Boolean *eventHandlingNeeded,
                            const fmi3Boolean *terminateSimulation, const fmi3Boolean *earlyReturn,
                            const fmi3Float64 *lastSuccessfulTime) {
    if (check_place(instance, eventHandlingNeeded, "eventHandlingNeeded") != StatusOK) return fmi3Error;
    if (check_place(instance, terminateSimulation, "terminateSimulation") != StatusOK) return fmi3Error;
    if (check_place(instance, earlyReturn, "earlyReturn") != StatusOK) return fmi3Error;
    return check_place(instance, lastSuccessfulTime, "lastSuccessfulTime");
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn,
                      fmi3Float64 *lastSuccessfulTime) {
    if (check_results(c, eventHandlingNeeded, terminateSimulation, earlyReturn, lastSuccessfulTime) != StatusOK)
        return fmi3Error;
    const Status status =
        DO_STEP(c, currentCommunicationPoint, communicationStepSize, noSetFMUStatePriorToCurrentPoint);
    *eventHandlingNeeded = fmi3False;
    *terminateSimulation = has_ended(c) ? fmi3True : fmi3False;
    *earlyReturn = status == StatusOK && ((Instance *)c)->returned_early;
    *lastSuccessfulTime = reached_time(c);
    return status;
}

fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    Instance *instance = c;
    if (require(instance, CO_SIMULATION_EVENT, "enter step mode") != StatusOK) return fmi3Error;
#ifdef CLOCK_INTERVAL
    if (instance->now.ticking)
        return report(instance, fmi3Error, "the tick of the clock needs fmi3UpdateDiscreteStates first.");
#endif
    instance->now.phase = STEP;
    return fmi3OK;
}

/* ---- Model Exchange -------------------------------------------------------------------- */

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined, fmi3Float64 *nextEventTime) {
    fmi3Boolean *const flags[] = {discreteStatesNeedUpdate, terminateSimulation, nominalsOfContinuousStatesChanged,
                                  valuesOfContinuousStatesChanged, nextEventTimeDefined};
    if (require(c, EVENT | CO_SIMULATION_EVENT, "update discrete states") != StatusOK) return fmi3Error;
    for (size_t i = 0; i < sizeof flags / sizeof *flags; i++)
        if (check_place(c, flags[i], "the event information") != StatusOK) return fmi3Error;
    if (check_place(c, nextEventTime, "the event information") != StatusOK) return fmi3Error;
    for (size_t i = 0; i < sizeof flags / sizeof *flags; i++) *flags[i] = fmi3False;
    *nextEventTime = 0.0;
#ifdef CLOCK_INTERVAL
    Instance *instance = c;
    if (instance->now.ticking) {
        if (tick(instance) != StatusOK) return fmi3Error;
        instance->now.ticking = 0;
        report_limits(instance);
    }
#endif
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *nContinuousStates) {
    if (check_place(c, nContinuousStates, "the number") != StatusOK) return fmi3Error;
    *nContinuousStates = N_STATES;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *nEventIndicators) {
    if (check_place(c, nEventIndicators, "the number") != StatusOK) return fmi3Error;
    *nEventIndicators = 0;
    return fmi3OK;
}

/* ---- what a block has not -------------------------------------------------------------- */

#include "fmi3_lacking.h"

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { return lacks(c, "discrete states to evaluate"); }
