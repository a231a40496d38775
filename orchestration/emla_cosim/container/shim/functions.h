/* The functions of the parts, by their names in FMI without prefix, and the reason for which one is needed: a library
 * may lack those that are not.
 */

enum { ALWAYS = 1, FOR_STATES = 2, FOR_BYTES = 4, FOR_EVENTS = 8, FOR_BINARY = 16, NEVER = 0 };

/* X(p, name, need); p is passed on. */
#define FUNCTIONS_2(X, p)                                                                                     \
    X(p, Instantiate, ALWAYS) X(p, FreeInstance, ALWAYS) X(p, SetupExperiment, ALWAYS)                        \
    X(p, EnterInitializationMode, ALWAYS) X(p, ExitInitializationMode, ALWAYS) X(p, Terminate, ALWAYS)        \
    X(p, GetReal, ALWAYS) X(p, GetInteger, ALWAYS) X(p, GetBoolean, ALWAYS) X(p, GetString, ALWAYS)           \
    X(p, SetReal, ALWAYS) X(p, SetInteger, ALWAYS) X(p, SetBoolean, ALWAYS) X(p, SetString, ALWAYS)           \
    X(p, SetRealInputDerivatives, ALWAYS) X(p, DoStep, ALWAYS) X(p, GetBooleanStatus, ALWAYS)                 \
    X(p, GetFMUstate, FOR_STATES) X(p, SetFMUstate, FOR_STATES) X(p, FreeFMUstate, FOR_STATES)                \
    X(p, SerializedFMUstateSize, FOR_BYTES) X(p, SerializeFMUstate, FOR_BYTES)                                \
    X(p, DeSerializeFMUstate, FOR_BYTES)

#define FUNCTIONS_3(X, p)                                                                                     \
    X(p, InstantiateCoSimulation, ALWAYS) X(p, FreeInstance, ALWAYS) X(p, EnterInitializationMode, ALWAYS)    \
    X(p, ExitInitializationMode, ALWAYS) X(p, Terminate, ALWAYS) X(p, DoStep, ALWAYS)                         \
    X(p, GetFloat64, ALWAYS) X(p, GetFloat32, ALWAYS) X(p, GetInt8, ALWAYS) X(p, GetUInt8, ALWAYS)            \
    X(p, GetInt16, ALWAYS) X(p, GetUInt16, ALWAYS) X(p, GetInt32, ALWAYS) X(p, GetUInt32, ALWAYS)             \
    X(p, GetInt64, ALWAYS) X(p, GetUInt64, ALWAYS) X(p, GetBoolean, ALWAYS) X(p, GetString, ALWAYS)           \
    X(p, SetFloat64, ALWAYS) X(p, SetFloat32, ALWAYS) X(p, SetInt8, ALWAYS) X(p, SetUInt8, ALWAYS)            \
    X(p, SetInt16, ALWAYS) X(p, SetUInt16, ALWAYS) X(p, SetInt32, ALWAYS) X(p, SetUInt32, ALWAYS)             \
    X(p, SetInt64, ALWAYS) X(p, SetUInt64, ALWAYS) X(p, SetBoolean, ALWAYS) X(p, SetString, ALWAYS)           \
    X(p, GetBinary, FOR_BINARY) X(p, SetBinary, FOR_BINARY)                                                   \
    X(p, GetFMUState, FOR_STATES) X(p, SetFMUState, FOR_STATES) X(p, FreeFMUState, FOR_STATES)                \
    X(p, SerializedFMUStateSize, FOR_BYTES) X(p, SerializeFMUState, FOR_BYTES)                                \
    X(p, DeserializeFMUState, FOR_BYTES)                                                                      \
    X(p, EnterEventMode, FOR_EVENTS) X(p, EnterStepMode, FOR_EVENTS) X(p, UpdateDiscreteStates, FOR_EVENTS)   \
    X(p, SetClock, FOR_EVENTS) X(p, GetClock, FOR_EVENTS) X(p, GetIntervalDecimal, FOR_EVENTS)                \
    X(p, GetShiftDecimal, FOR_EVENTS)

#define INDEX(version, name, need) version##_##name,

enum { FUNCTIONS_2(INDEX, FMI2) N_FUNCTIONS_2 };
enum { FUNCTIONS_3(INDEX, FMI3) N_FUNCTIONS_3 };

enum { N_FUNCTIONS = (int)N_FUNCTIONS_3 > (int)N_FUNCTIONS_2 ? (int)N_FUNCTIONS_3 : (int)N_FUNCTIONS_2 };

typedef struct {
    const char *name;
    int need;
} FunctionName;

#define NAME_2(p, name, need) {"fmi2" #name, need},
#define NAME_3(p, name, need) {"fmi3" #name, need},

/* An FMU of FMI 2.0 that is compiled in: its functions have a prefix. */
#define DECLARE_WITH(prefix, name, need) fmi2##name##TYPE prefix##_fmi2##name;
#define ADDRESS_WITH(prefix, name, need) (Function)prefix##_fmi2##name,
#define COMPILED_IN(prefix)           \
    FUNCTIONS_2(DECLARE_WITH, prefix) \
    static const Function prefix##_functions[] = {FUNCTIONS_2(ADDRESS_WITH, prefix)};
