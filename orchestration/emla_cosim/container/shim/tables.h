/* The records of system.h that the stepper does not know. Positions count from 0. */

#define ROOM(n) ((n) > 0 ? (n) : 1) /* C has no empty arrays */

/* An FMU. Its functions are compiled in, or come from a library in the resources. */
typedef struct {
    const char *guid;
    const char *folder;        /* of its files, in the resources */
    const char *file;          /* of its library there, without folder and suffix; NULL if compiled in */
    const Function *functions; /* NULL if not compiled in */
    int fmi;                   /* its version of FMI */
    int needs;                 /* the reasons for which its functions are needed */
} Library;

/* A component: one instance of an FMU. */
typedef struct {
    const char *name;
    int library;
    int first_setter, n_setters; /* in the calls of the instance: in initialization mode they set all inputs, */
    int first_getter, n_getters; /* and get all signals */
    int uses_event_mode, may_return_early;
    int events;                  /* place of its events; -1 without event mode, clocks and early returns */
    int first_event, n_event;    /* the memory of these in `saved`, */
    int first_count;             /* and in this the numbers of ticks */
    const char *const *clocks;   /* their names */
    double tolerance;            /* of its solver; 0 for its own */
} Part;

enum { TYPE_TEXT = TYPE_BOOLEAN_2 + 1 }; /* a type of values, after those of the stepper */

enum { NEVER_SET, ALWAYS_SET, SET_BEFORE_STEPS }; /* when a host may set a variable */
enum { AT_ONCE, IN_EVENT_MODE, AT_TICKS };        /* how its part takes it while stepping */

/* A variable of this FMU: that of a part. */
typedef struct {
    const char *name;
    char type; /* for the host, as a letter */
    signed char own; /* that of the part */
    char settable, way;
    int part; /* -1 for the time */
    fmi2ValueReference reference;
    int place, size; /* in its array; 0 and 1 for a scalar */
    int array;       /* place of its array in `saved`, or of a value that is set at ticks; -1 without */
    int signal;      /* its signal, or -1 */
    int kept;        /* place of the value at its last tick in `saved`; -1 without */
} Variable;

/* A start value that differs from that of the part. */
typedef struct {
    int variable;
    double value;
    const char *text; /* of a String */
} Start;

/* Parts that are initialized together. */
typedef struct {
    int first_member, n_members;    /* in initial_members[] */
    int first_coupling, n_coupling; /* in initial_coupling[] and initial_guesses[] */
} Loop;

/* A connection of Strings, or of Binary values of at most so many bytes. */
typedef struct {
    int source, target; /* parts */
    fmi2ValueReference output, input;
    int is_binary, way;
    size_t most_bytes; /* 0 without limit */
    const char *source_name, *target_name;
} TextLink;
