/* What the headers for both versions of FMI need of FMI 2.0: its types, and its names of functions. */

#define FMI(name) fmi2##name


/* Functions that FMI 3.0 only calls otherwise. */
#define fmi2GetFMUState fmi2GetFMUstate
#define fmi2SetFMUState fmi2SetFMUstate
#define fmi2FreeFMUState fmi2FreeFMUstate
#define fmi2SerializedFMUStateSize fmi2SerializedFMUstateSize
#define fmi2SerializeFMUState fmi2SerializeFMUstate
#define fmi2DeserializeFMUState fmi2DeSerializeFMUstate
#define fmi2GetContinuousStateDerivatives fmi2GetDerivatives
#define fmi2GetOutputDerivatives fmi2GetRealOutputDerivatives

/* FMI 3.0 passes the number of values, which differs from that of variables if these are arrays. */
#define COUNTED(count)
#define COUNT_OF(count, variables) (variables)
#define N_VARIABLES N_VALUES

typedef fmi2Status Status;
#define StatusOK fmi2OK
#define StatusWarning fmi2Warning
#define StatusDiscard fmi2Discard
#define StatusError fmi2Error

enum { FOR_MODEL_EXCHANGE = fmi2ModelExchange, FOR_CO_SIMULATION = fmi2CoSimulation };

typedef fmi2Component Handle;
typedef fmi2ComponentEnvironment Environment;
typedef fmi2CallbackLogger Logger;
typedef fmi2ValueReference ValueReference;
typedef fmi2Integer Integer;
typedef fmi2Boolean Boolean;
typedef fmi2String String;
typedef fmi2Byte Byte;
typedef fmi2FMUstate FmuState;

#define LOG(instance, status, category, message) \
    (instance)->logger((instance)->environment, (instance)->name, status, category, message)

#define TOKEN_NAME "GUID"

#define TYPE_NAME(type) ((type) == 'R' ? "Real" : (type) == 'I' ? "Integer" : "Boolean")
