/* A co-simulation stepper: the tables of a system, its memory, and what ended a run.
 *
 * An algorithm is a program: a table of operations that is worked through in each step. The tables never change
 * during a run; the memory holds all that does. There is no global state, so several steppers can run at once.
 * Positions count from 0. The order of all floating-point operations is fixed, so that the results have the same
 * bits on any machine.
 */
#ifndef STEPPER_H
#define STEPPER_H

#include <stddef.h>
#include <stdint.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#ifndef STEPPER_EVENTS /* an exported system leaves out what it has not, */
#define STEPPER_EVENTS 1
#define STEPPER_GROUPS 1
#define STEPPER_DIVISIONS 1
#define STEPPER_WATCHED 1 /* and that somebody reads what is called, and how long it takes */
#endif

#ifndef STEPPER_API
#define STEPPER_API /* what makes a function visible outside of a library */
#endif

typedef void (*Function)(void); /* any FMI function; called with its own type */

/* The types of values in the memory of a call. Enumerations are TYPE_INT32 in FMI 2.0, TYPE_INT64 in FMI 3.0. */
enum {
    TYPE_FLOAT64,
    TYPE_FLOAT32,
    TYPE_INT8,
    TYPE_UINT8,
    TYPE_INT16,
    TYPE_UINT16,
    TYPE_INT32,
    TYPE_UINT32,
    TYPE_INT64,
    TYPE_UINT64,
    TYPE_BOOLEAN,
    TYPE_BOOLEAN_2
};

/* What an instance is doing, for other processes; the beginning of `Activity` of crash_page.py. */
typedef struct {
    int64_t code; /* of instance and call; 0 without one */
    double time;  /* at which its step begins */
    int64_t rows; /* complete rows since the beginning of the run */
} Activity;

/* One FMI call that sets inputs, or gets signals or observed variables, of one type. */
typedef struct {
    Function function; /* NULL if it only copies numbers from `values` */
    void *component;
    const fmi2ValueReference *references;
    void *values; /* what the FMI function gets or sets */
    int64_t code; /* in `Activity` */
    int32_t n_references, n_values;
    int32_t is_version_3;  /* of FMI */
    int32_t n_items;       /* 0 if `values` are the numbers themselves; otherwise it is also converted: */
    const int32_t *items;  /* positions of the numbers in the vector of the stepper, */
    const int32_t *places; /* and in `values`, which has whole arrays */
    int32_t type;
    int32_t instance;
} Call;

/* What fmi3DoStep tells besides its status; `StepEnd` of fmi_3_calls.py. */
typedef struct {
    fmi3Boolean needs_event, terminates, is_early;
    double reached;
} StepEnd;

/* What the calls of an instance took; the last member keeps those of two threads apart in their caches. */
enum { INPUT_CALLS, STEP_CALLS, OUTPUT_CALLS, STATE_CALLS, RECORDING_CALLS, N_KINDS };
typedef struct {
    int64_t (*now)(void); /* a monotonic clock in ns */
    int64_t counts[N_KINDS], nanoseconds[N_KINDS], unused[N_KINDS];
} Effort;

typedef struct Events Events; /* event_tables.h */

/* The place of a saved state: that of the FMU, and a copy of the memory of its events. */
typedef struct {
    void *state;
    double *events;
} SavedState;

enum { HOLD, MIDDLE, LINE }; /* how inputs change during a step; `Mode` of extrapolation.py */

/* What an input reads of a signal that is known in advance; `Known` of extrapolation.py. */
enum { NOT_KNOWN, KNOWN_SAMPLE, KNOWN_BEGIN, KNOWN_LINE, KNOWN_MEAN };
enum { SPAN_BEGIN, SPAN_END, SPAN_MEAN }; /* what known signals did in the last step, one vector each */

typedef struct { /* first what each step reads */
    void *component;
    Function do_step;
    const Call *setters, *getters; /* of its inputs and signals */
    int64_t code;                  /* in `Activity`, for the calls below */
    int32_t code_step;
    int32_t n_setters, n_getters;
    int32_t first_input, n_inputs, first_output, n_outputs;
    int32_t mode;
    int32_t is_version_3;    /* of FMI */
    int32_t has_no_way_back; /* whether none of its states is restored */
    int32_t is_rare;         /* whether it reads inputs more rarely than each step */
    int32_t is_held;         /* whether all its inputs are the newest signals */
    int32_t has_slopes;      /* whether it gets derivatives of its inputs */
    int32_t code_derivatives, code_save, code_restore, code_status;
    Function set_derivatives, get_state, set_state;
    Function get_status;                  /* fmi2GetBooleanStatus; NULL without it */
    fmi2Status (*end_step)(fmi2Component); /* waits for a step that `do_step` only begins; NULL without */
    const fmi2ValueReference *references; /* of its inputs, and the orders of their derivatives */
    const fmi2Integer *orders;
    StepEnd *end; /* for FMI 3.0 */
    SavedState *state; /* the place of the one that its group saves */
    Events *events; /* NULL without event mode, clocks and early returns */
    Effort *effort; /* NULL if its calls are not measured */
} FmuInstance;

/* A connected input: factor * signal + offset. */
typedef struct {
    double factor, offset;
    int32_t signal;
    int32_t moves; /* whether signal and input are continuous */
    int32_t known;
    int32_t unused;
} Input;

/* An output that is exchanged. */
typedef struct {
    double floor; /* lower bound of its size */
    int32_t instance;
    int32_t is_smooth; /* whether it is continuous */
} Signal;

/* The last two replace DO_STEP and END_STEP of an instance that has discarded a step. */
enum { SET_INPUTS, DO_STEP, GET_OUTPUTS, SOLVE, COMBINE, END_STEP, DIVIDE_STEP, END_DIVIDED_STEP };

/* `target` is an instance, a group for SOLVE, or a combination for COMBINE. */
typedef struct {
    int64_t every; /* it is done in every so many steps, for all of these at once */
    int32_t call, target;
    int32_t store; /* for SET_INPUTS: the vector that the inputs are read from; 0 are the signals */
    int32_t unused;
} Operation;

/* Signals of an instance in the vector `into` become a sum of factor * vector. */
typedef struct {
    int32_t instance, into, first_term, n_terms;
} Combination;

typedef struct {
    double factor;
    int32_t store;
    int32_t unused;
} Term;

enum { SIGNALS, PREVIOUS, FIRST_STORE }; /* positions of vectors as long as the signals */

/* Instances that repeat their step until the values that they exchange agree. The memory is for n coupling
 * variables, and room for a matrix is n * n, a history is sweeps * n. */
typedef struct {
    const int32_t *members;
    const int32_t *coupling;     /* signals */
    const Operation *operations; /* of a sweep over the members, in each step */
    double *jacobian;        /* which is kept from step to step */
    double *guess, *sizes, *direction, *earlier, *basis, *residuals, *answers;
    double *kept; /* signals, previous signals and two times of each member at the start of the step */
    int32_t n_members, n_coupling, n_operations;
    int32_t is_saved;  /* whether the step can be repeated */
    int32_t is_halved; /* whether it can be done in halves */
} Group;

/* Communication point k is (first + k * per_step) / denominator, so that only the division rounds. */
typedef struct {
    double first, per_step, denominator;
} Clock;

/* Why a run of steps ended. */
enum {
    DONE,
    SET_FAILED,
    DERIVATIVES_FAILED,
    STEP_FAILED,
    GET_FAILED,
    NOT_FINITE,
    SAVE_FAILED,
    RESTORE_FAILED,
    NO_AGREEMENT,
    OBSERVE_FAILED,
    LATE,
    INTERRUPTED,
    TOO_SHORT /* the error is too large with the shortest step */
};

/* Steps that an instance discarded as a whole, and did in parts. */
typedef struct {
    int64_t steps;
    double shortest; /* part in s */
} Division;

#define OUT_OF_RANGE INT32_MIN /* a status: a value does not fit into the type of its input */

typedef struct {
    /* tables */
    const FmuInstance *instances;
    const Input *inputs;
    const Signal *signals;
    const Operation *operations;
    const Combination *combinations;
    const Term *terms;
    const Group *groups;
    const int32_t *read;   /* signals that must be finite */
    const int32_t *follows; /* for each instance, whether outputs follow known inputs that are set after a step */
    const Call *observers; /* of variables that are recorded besides the signals */
    double coupling_tolerance;
    int32_t n_signals, n_operations, n_groups, n_read, n_observers, n_observed;
    int32_t sweeps, halvings; /* limits */
    int32_t first_span;       /* among the vectors: the first of those with what known signals did */

    /* memory */
    double *const *stores; /* vectors; the first two are the signals, and those one communication point earlier */
    double *at, *before;   /* times of these, for each instance */
    double *input_values, *derivatives;
    double *taken, *taken_at; /* signal that an input with a rare reader read last, and its time */
    double *largest;          /* absolute values of the signals so far */
    double *observed;
    Division *divisions; /* for each instance; NULL if no steps are divided */
    Activity *activity; /* NULL if nobody reads it */
    const volatile int32_t *stop; /* ends the run before the next step if it is not 0; NULL without */
    Clock clock;
    double last_point; /* no point is later: the stop time of a host may be one rounding error before its point */

    /* what came out */
    int64_t reached;  /* steps that are done */
    int64_t recorded; /* rows */
    int64_t sweeps_done;
    double time, length; /* of the step that failed; halves are shorter */
    int32_t failure, instance, status, group, group_sweeps;
} Stepper;

/* A signal whose error is controlled. */
typedef struct {
    int32_t signal;
    int32_t is_unread;  /* by any instance */
    int32_t is_instant; /* it depends directly on an extrapolated input: its errors do not add up */
} Controlled;

/* Error control of all instances; errors are relative to the sizes of signals. */
typedef struct {
    /* tables */
    Controlled *controlled;
    double tolerance, divisor, start;
    double leap_limit, short_limit; /* lengths of steps: to just before an event, and very short ones */
    double shortest, longest;
    int32_t n_controlled, n_instances;

    /* memory */
    SavedState *states;     /* of the instances at the start of a trial */
    double *memory, *copy;  /* what a trial changes besides */
    double *coarse, *next_coarse; /* the same after the whole step of the last step, and of the trial */
    int64_t n_memory;
    double *whole, *errors, *judged; /* of a trial */
    double *total;                   /* absolute errors of all steps: their sum, or the largest if they do not add up */
    double *first_errors;            /* of the first step that was rejected at this time */
    int32_t *jumps, *jumped;         /* jumps of each signal in this step, and in the last one; if unread, so far */
    double time, step, last_error, exponent;
    double first_rejected; /* its length; NaN without one */
    double coarse_time;    /* of `coarse`; NaN without it */
    int64_t accepted, rejected;
    int32_t is_per_unit; /* whether the error per unit step is controlled */

    /* where to go */
    int32_t is_event;     /* at `point` */
    double point, enough; /* times to reach exactly, and at which to return */

    /* what came out */
    int64_t tried;
    double end; /* of the last trial */
    int32_t is_met; /* whether `point` is reached */
    int32_t worst;  /* signal with the largest error */
} Control;

/* Sizes of Call, FmuInstance, Input, Signal, Operation, Combination, Term, Group, Stepper, Controlled, Control,
 * SavedState, Effort and Division. */
extern STEPPER_API const size_t stepper_sizes[];

/* Set, step and get as the program says, for one step; returns why it failed, or DONE. */
STEPPER_API int32_t stepper_step(Stepper *stepper, int64_t k);

/* Do `count` steps from step `first` on, and fill rows of time, signals and observed variables after every
 * `every`-th step. Returns why it ended: at the latest with the present second of wall time. */
STEPPER_API int32_t stepper_run(Stepper *stepper, int64_t first, int64_t count, int64_t every, double *rows);

/* Try at most `most` steps to a point of time, and fill a row after each that is accepted; `room` rows at most, none
 * if `rows` is NULL. Returns why it ended, as stepper_run does. */
STEPPER_API int32_t stepper_control(Stepper *stepper, Control *control, int64_t most, int64_t room, double *rows);

#endif
