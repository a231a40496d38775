/* The FMU of ../integrated for FMI 3.0: each function calls the one of FMI 2.0, so that results have the same bits.
   INDICATORS is the number of event indicators that it says it has. */
#include "../integrated/integrated.c"

#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))
#define TIME 20

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String c[]) { return fmi3OK; }
EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                 fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                                 fmi3LogMessageCallback message) {
    return fmi2Instantiate(name, fmi2ModelExchange, token, path, NULL, visible, logging);
}
EXPORT void fmi3FreeInstance(fmi3Instance i) { fmi2FreeInstance(i); }
EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance i, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                              fmi3Float64 start, fmi3Boolean ends, fmi3Float64 stop) {
    return (fmi3Status)fmi2SetupExperiment(i, has_tolerance, tolerance, start, ends, stop);
}

#define SAME(Name) \
    EXPORT fmi3Status fmi3##Name(fmi3Instance i) { return (fmi3Status)fmi2##Name(i); }
SAME(ExitInitializationMode)
SAME(Terminate)
SAME(Reset)
SAME(EnterEventMode)
SAME(EnterContinuousTimeMode)

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t n, fmi3Float64 v[], size_t nv) {
    for (size_t k = 0; k < n; k++) v[k] = r[k] == TIME ? ((Model *)i)->time : get(i, r[k]);
    return n == nv ? fmi3OK : fmi3Error;
}
EXPORT fmi3Status fmi3SetFloat64(fmi3Instance i, const fmi3ValueReference r[], size_t n, const fmi3Float64 v[],
                                 size_t nv) {
    return n == nv ? (fmi3Status)fmi2SetReal(i, r, n, v) : fmi3Error;
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *s) { return (fmi3Status)fmi2GetFMUstate(i, s); }
EXPORT fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState s) { return (fmi3Status)fmi2SetFMUstate(i, s); }
EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *s) { return (fmi3Status)fmi2FreeFMUstate(i, s); }
EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState s, size_t *n) {
    return (fmi3Status)fmi2SerializedFMUstateSize(i, s, n);
}
EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState s, fmi3Byte b[], size_t n) {
    return (fmi3Status)fmi2SerializeFMUstate(i, s, (fmi2Byte *)b, n);
}
EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte b[], size_t n, fmi3FMUState *s) {
    return (fmi3Status)fmi2DeSerializeFMUstate(i, (const fmi2Byte *)b, n, s);
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance i, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                           fmi3Boolean *states, fmi3Boolean *has_next, fmi3Float64 *next) {
    fmi2EventInfo info;
    fmi2Status status = fmi2NewDiscreteStates(i, &info);
    if (status != fmi2OK) return (fmi3Status)status;
    *again = info.newDiscreteStatesNeeded;
    *end = info.terminateSimulation;
    *nominals = info.nominalsOfContinuousStatesChanged;
    *states = info.valuesOfContinuousStatesChanged;
    *has_next = info.nextEventTimeDefined;
    *next = info.nextEventTime;
    return fmi3OK;
}
EXPORT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance i, fmi3Boolean final, fmi3Boolean *enter, fmi3Boolean *end) {
    fmi2Boolean enters, ends;
    fmi2Status status = fmi2CompletedIntegratorStep(i, final, &enters, &ends);
    if (status != fmi2OK) return (fmi3Status)status;
    *enter = enters;
    *end = ends;
    return fmi3OK;
}
EXPORT fmi3Status fmi3SetTime(fmi3Instance i, fmi3Float64 time) { return (fmi3Status)fmi2SetTime(i, time); }
EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance i, const fmi3Float64 x[], size_t n) {
    return (fmi3Status)fmi2SetContinuousStates(i, x, n);
}

#define READ(Name3, Name2) \
    EXPORT fmi3Status fmi3Get##Name3(fmi3Instance i, fmi3Float64 x[], size_t n) { return (fmi3Status)fmi2Get##Name2(i, x, n); }
READ(ContinuousStates, ContinuousStates)
READ(ContinuousStateDerivatives, Derivatives)
READ(EventIndicators, EventIndicators)
READ(NominalsOfContinuousStates, NominalsOfContinuousStates)

EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance i, size_t *n) {
    *n = 3;
    return fmi3OK;
}
EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance i, size_t *n) {
    *n = INDICATORS;
    return fmi3OK;
}

/* Functions that a host looks up, and that this FMU has no use for. */
#define ABSENT(name) EXPORT fmi3Status name(void) { return fmi3Error; }
#define ABSENT_TYPE(Type) ABSENT(fmi3Get##Type) ABSENT(fmi3Set##Type)
ABSENT_TYPE(Float32)
ABSENT_TYPE(Int8)
ABSENT_TYPE(UInt8)
ABSENT_TYPE(Int16)
ABSENT_TYPE(UInt16)
ABSENT_TYPE(Int32)
ABSENT_TYPE(UInt32)
ABSENT_TYPE(Int64)
ABSENT_TYPE(UInt64)
ABSENT_TYPE(Boolean)
ABSENT_TYPE(String)
ABSENT_TYPE(Binary)
ABSENT_TYPE(Clock)
ABSENT_TYPE(IntervalDecimal)
ABSENT_TYPE(IntervalFraction)
ABSENT_TYPE(ShiftDecimal)
ABSENT_TYPE(ShiftFraction)
ABSENT(fmi3ActivateModelPartition)
ABSENT(fmi3DoStep)
ABSENT(fmi3EnterConfigurationMode)
ABSENT(fmi3EnterStepMode)
ABSENT(fmi3EvaluateDiscreteStates)
ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3GetAdjointDerivative)
ABSENT(fmi3GetDirectionalDerivative)
ABSENT(fmi3GetNumberOfVariableDependencies)
ABSENT(fmi3GetOutputDerivatives)
ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3InstantiateCoSimulation)
ABSENT(fmi3InstantiateScheduledExecution)
