/* The functions of parts of FMI 3.0. */

/* Those with the arguments of FMI 2.0: their names there, and in FMI 3.0. They are called by those of FMI 2.0. */
#define SHARED_ALWAYS(X)                                  \
    X(FreeInstance, FreeInstance)                         \
    X(ExitInitializationMode, ExitInitializationMode)     \
    X(Terminate, Terminate)
#define SHARED_STATE(X)               \
    X(GetFMUstate, GetFMUState)       \
    X(SetFMUstate, SetFMUState)       \
    X(FreeFMUstate, FreeFMUState)
#define SHARED_BYTES(X)                                 \
    X(SerializedFMUstateSize, SerializedFMUStateSize)   \
    X(SerializeFMUstate, SerializeFMUState)             \
    X(DeSerializeFMUstate, DeserializeFMUState)

#define SHARED_FUNCTIONS(X) SHARED_ALWAYS(X) SHARED_STATE(X) SHARED_BYTES(X)

/* Those with arguments of their own. */
#define FUNCTIONS_3(X)                                                    \
    X(InstantiateCoSimulation)                                            \
    X(EnterInitializationMode)                                            \
    X(DoStep)                                                             \
    X(GetFloat64) X(GetFloat32) X(GetInt8) X(GetUInt8) X(GetInt16)        \
    X(GetUInt16) X(GetInt32) X(GetUInt32) X(GetInt64) X(GetUInt64)        \
    X(GetBoolean) X(GetString)                                            \
    X(SetFloat64) X(SetFloat32) X(SetInt8) X(SetUInt8) X(SetInt16)        \
    X(SetUInt16) X(SetInt32) X(SetUInt32) X(SetInt64) X(SetUInt64)        \
    X(SetBoolean) X(SetString)

typedef struct {
#define DECLARE_3(name) fmi3##name##TYPE *name;
    FUNCTIONS_3(DECLARE_3)
} Functions3;
