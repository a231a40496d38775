/* An FMU's library as a host sees it: a table of the functions of FMI 2.0, found by name.
 *
 * Functions are called as fmu.DoStep(...). Those of Model Exchange are NULL where the library has
 * none; everything else must be there.
 */
#ifndef FMU_H
#define FMU_H

#include <stdio.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
#define dlopen(path, flags) ((void *)LoadLibraryA(path))
#define dlsym(library, name) ((void *)GetProcAddress(library, name))
#define dlerror() "LoadLibrary failed"
#else
#include <dlfcn.h>
#endif

#include "fmi2FunctionTypes.h"

#define CO_SIMULATION_FUNCTIONS(F)                                                                    \
    F(GetTypesPlatform) F(GetVersion) F(SetDebugLogging)                                              \
    F(Instantiate) F(FreeInstance)                                                                    \
    F(SetupExperiment) F(EnterInitializationMode) F(ExitInitializationMode) F(Terminate) F(Reset)     \
    F(GetReal) F(GetInteger) F(GetBoolean) F(GetString)                                               \
    F(SetReal) F(SetInteger) F(SetBoolean) F(SetString)                                               \
    F(GetFMUstate) F(SetFMUstate) F(FreeFMUstate)                                                     \
    F(SerializedFMUstateSize) F(SerializeFMUstate) F(DeSerializeFMUstate)                             \
    F(GetDirectionalDerivative) F(SetRealInputDerivatives) F(GetRealOutputDerivatives)                \
    F(DoStep) F(CancelStep)                                                                           \
    F(GetStatus) F(GetRealStatus) F(GetIntegerStatus) F(GetBooleanStatus) F(GetStringStatus)

#define MODEL_EXCHANGE_FUNCTIONS(F)                                                                   \
    F(EnterEventMode) F(NewDiscreteStates) F(EnterContinuousTimeMode) F(CompletedIntegratorStep)      \
    F(SetTime) F(SetContinuousStates) F(GetContinuousStates) F(GetNominalsOfContinuousStates)         \
    F(GetDerivatives) F(GetEventIndicators)

typedef struct {
#define MEMBER(name) fmi2##name##TYPE *name;
    CO_SIMULATION_FUNCTIONS(MEMBER)
    MODEL_EXCHANGE_FUNCTIONS(MEMBER)
#undef MEMBER
} Fmu;

/* Load a library; what is wrong with it, or NULL. It stays loaded until the process ends, so that
 * reports of leaks and races at the end still find its symbols. */
static const char *load_fmu(Fmu *fmu, const char *path) {
    static char problem[5000];
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) return dlerror();
    /* ISO C has no conversion from dlsym's data pointer to a function's: POSIX says to write it so */
#define FIND(name) *(void **)(&fmu->name) = dlsym(library, "fmi2" #name);
    CO_SIMULATION_FUNCTIONS(FIND)
    MODEL_EXCHANGE_FUNCTIONS(FIND)
#undef FIND
    const char *missing = NULL;
#define REQUIRE(name) if (fmu->name == NULL) missing = "fmi2" #name;
    CO_SIMULATION_FUNCTIONS(REQUIRE)
#undef REQUIRE
    if (missing != NULL) {
        snprintf(problem, sizeof problem, "%s has no function %s", path, missing);
        return problem;
    }
    if (strcmp(fmu->GetVersion(), "2.0") != 0 || strcmp(fmu->GetTypesPlatform(), "default") != 0) {
        snprintf(problem, sizeof problem, "%s is not of FMI 2.0 with the default types", path);
        return problem;
    }
    return NULL;
}

static inline const char *status_name(fmi2Status status) {
    static const char *const names[] = {"fmi2OK",    "fmi2Warning", "fmi2Discard",
                                        "fmi2Error", "fmi2Fatal",   "fmi2Pending"};
    return (unsigned)status < sizeof names / sizeof *names ? names[status] : "an unknown status";
}

#endif
