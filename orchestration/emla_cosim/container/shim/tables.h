/* The records of system.h, which describe a system. Positions count from 0. */

#define ROOM(n) ((n) > 0 ? (n) : 1) /* C has no empty arrays */

/* An FMU. Its functions are compiled in, or come from a library in the resources. */
typedef struct {
    const char *guid;
    const char *folder;         /* of its files, in the resources */
    const char *file;           /* of its library there, without folder and suffix; NULL if compiled in */
    const Functions *functions; /* NULL if not compiled in */
    int fmi;                    /* its version of FMI */
} Library;

enum { HOLD, MIDDLE, LINE }; /* how inputs change during a step */

/* A component: one instance of an FMU. */
typedef struct {
    const char *name;
    int library;
    int first_input, n_inputs;   /* its connected inputs */
    int first_output, n_outputs; /* its signals */
    int first_set, n_sets;       /* in calls[]: those that set its inputs, */
    int first_get, n_gets;       /* and those that get its signals */
    int mode;
    int multiple;    /* it does so many communication steps at once */
    int rare;        /* whether it reads inputs more rarely than each step */
    int typed;       /* whether it exchanges other types than Real (Float64), or arrays */
    int saved;       /* whether a group restores its states */
    double tolerance; /* of its solver; 0 for its own */
} Part;

/* A connected input: factor * signal + offset. */
typedef struct {
    int signal;
    int moves;    /* whether signal and input are continuous */
    double factor, offset, start;
} Input;

/* A signal: an output that is exchanged. */
typedef struct {
    int part;
    int smooth; /* whether it is continuous */
    double floor; /* lower bound of its size */
    const char *name;
} Signal;

/* A call that sets inputs, or gets signals, of one type. */
typedef struct {
    char type;
    int first_reference, n_references; /* in call_references[] */
    int first_item, n_items;           /* in call_items[], the inputs or signals, and call_places[] */
    int n_values;                      /* of the call, which has whole arrays */
    int elements;                      /* place of its array in the memory; -1 without one */
} Call;

enum { SET_INPUTS, STEP_PART, GET_OUTPUTS }; /* what a step does */

typedef struct {
    int call, part;
} Operation;

/* Parts that are stepped together until they agree. */
typedef struct {
    int first_member, n_members;   /* in members[] */
    int first_coupling, n_coupling; /* in coupling[] */
    int jacobian;                   /* the place of its matrix in jacobians[] */
    int saved;                      /* whether a step can be repeated */
    int halves;                     /* whether a step can be halved */
} Group;

/* A variable of this FMU: that of a part. */
typedef struct {
    const char *name;
    char type; /* for the host */
    char own;  /* that of the part */
    char settable; /* 0 never, 1 always, 2 until the end of initialization */
    int part; /* -1 for the time */
    fmi2ValueReference reference;
    int place, size; /* in its array; 0 and 1 for a scalar */
    int elements;    /* place of its array in the memory; -1 for a scalar, or if no element is set */
    int signal;      /* its signal, or -1 */
} Variable;

/* A start value that differs from that of the part. */
typedef struct {
    int variable;
    double value;
    const char *text; /* of a String */
} Start;
