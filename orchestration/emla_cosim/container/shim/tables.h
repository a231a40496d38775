/* The records of system.h, which describe a system. Positions count from 0. */

#define ROOM(n) ((n) > 0 ? (n) : 1) /* C has no empty arrays */

/* An FMU. Its functions are compiled in, or come from a library in the resources. */
typedef struct {
    const char *guid;
    const char *folder;         /* of its files, in the resources */
    const char *file;           /* of its library there, without folder and suffix; NULL if compiled in */
    const Functions *functions; /* NULL if not compiled in */
} Library;

enum { HOLD, MIDDLE, LINE }; /* how inputs change during a step */

/* A component: one instance of an FMU. */
typedef struct {
    const char *name;
    int library;
    int first_input, n_inputs;   /* its connected inputs */
    int first_output, n_outputs; /* its signals */
    int mode;
    int multiple;    /* it does so many communication steps at once */
    int rare;        /* whether it reads inputs more rarely than each step */
    int typed;       /* whether it exchanges other types than Real */
    int saved;       /* whether a group restores its states */
    double tolerance; /* of its solver; 0 for its own */
} Part;

/* A connected input: factor * signal + offset. */
typedef struct {
    fmi2ValueReference reference;
    char type; /* R Real, I Integer or enumeration, B Boolean, S String */
    int signal;
    int moves;    /* whether signal and input are continuous */
    double factor, offset, start;
} Input;

/* A signal: an output that is exchanged. */
typedef struct {
    fmi2ValueReference reference;
    char type;
    int part;
    int smooth; /* whether it is continuous */
    double floor; /* lower bound of its size */
    const char *name;
} Signal;

enum { SET, STEP_PART, GET }; /* calls of a step */

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
    char type; /* as that of an input; in FMI 3.0 that of an enumeration is E */
    char settable;
    int part; /* -1 for the time */
    fmi2ValueReference reference;
    int signal; /* its signal, or -1 */
} Variable;

/* A start value that differs from that of the part. */
typedef struct {
    int variable;
    double value;
    const char *text; /* of a String */
} Start;
