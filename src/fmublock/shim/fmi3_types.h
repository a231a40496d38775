/* What the headers for both versions of FMI need of FMI 3.0: its types, and its names of functions. */

#define FMI(name) fmi3##name

#define HAS_INTERMEDIATE_UPDATE /* no calls with a clock, whose ticks are the only steps */

#define EXPORTS_ALL_FUNCTIONS /* also those of the kinds that an FMU has not */

/* The number of values, which differs from that of variables if these are arrays. */
#define COUNTED(count) , size_t count
#define COUNT_OF(count, variables) (count)
#define N_VARIABLES (N_VALUES + 1)                /* the last one is the time */

typedef fmi3Status Status;
#define StatusOK fmi3OK
#define StatusWarning fmi3Warning
#define StatusDiscard fmi3Discard
#define StatusError fmi3Error

enum { FOR_MODEL_EXCHANGE, FOR_CO_SIMULATION };

typedef fmi3Instance Handle;
typedef fmi3InstanceEnvironment Environment;
typedef fmi3LogMessageCallback Logger;
typedef fmi3ValueReference ValueReference;
typedef fmi3Int32 Integer;
typedef fmi3Boolean Boolean;
typedef fmi3String String;
typedef fmi3Byte Byte;
typedef fmi3FMUState FmuState;

#define LOG(instance, status, category, message) \
    (instance)->logger((instance)->environment, status, category, message)

#define TOKEN_NAME "instantiation token"

#define TYPE_NAME(type) \
    ((type) == 'R' ? "Float64" : (type) == 'I' ? "Int32" : (type) == 'E' ? "Enumeration (Int64)" : "Boolean")
