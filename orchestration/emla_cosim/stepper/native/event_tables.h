/* Event mode, clocks and early returns of an instance of FMI 3.0: its tables, its memory, and what went wrong.
 *
 * Clocks are known by their positions in `clocks`. Sets of clocks are parts of one list, in which -1 is a clock that
 * the FMU does not have. All that a step changes is in one memory, which is saved together with the FMU's state.
 */
#ifndef EVENT_TABLES_H
#define EVENT_TABLES_H

#include "stepper.h"

/* What is called; the first ones are FMI functions. `EventCall` of event_layout.py. */
enum {
    FMI_DO_STEP,
    FMI_ENTER_EVENT_MODE,
    FMI_ENTER_STEP_MODE,
    FMI_UPDATE_DISCRETE_STATES,
    FMI_SET_CLOCK,
    FMI_GET_CLOCK,
    FMI_GET_INTERVAL_DECIMAL,
    FMI_GET_SHIFT_DECIMAL,
    N_EVENT_FUNCTIONS,
    SETTING_INPUTS = N_EVENT_FUNCTIONS,
    GETTING_CLOCKED_VARIABLES,
    SETTING_BY_HAND
};

/* What went wrong; `Problem` of event_layout.py. The members of `Events` in brackets say more. */
enum {
    NO_PROBLEM,
    CALL_FAILED,       /* [call, status] */
    RUN_ENDED,         /* the FMU asks for the end [call, value: time in s] */
    RETURN_REFUSED,    /* a step ended early, and must not */
    EVENT_REFUSED,     /* a step needs event mode, and must not */
    WRONG_TIME,        /* a step ended before its start or after its end [value: time in s] */
    NO_EVENT_TIME,     /* the next event is at NaN */
    ENDLESS_UPDATES,   /* [count] */
    ENDLESS_RETURNS,   /* [count] */
    ENDLESS_TICKS,     /* [clock, count] */
    TICK_WITHIN_STEP,  /* of an FMU that cannot vary its steps [value: time in s] */
    TICK_ALONE,        /* without a clock that it depends on [clock] */
    TOO_MANY_TICKS,    /* [clock, count, value: end of the step in s] */
    WRONG_INTERVAL,    /* [clock, value: in s] */
    WRONG_SHIFT        /* [clock, value: in s] */
};

typedef struct {
    int32_t first, count;
} ClockSet;

/* A call for clocked variables: it is allowed while one of their clocks ticks. */
typedef struct {
    Call call;
    ClockSet clocks;
} ClockedCall;

enum { DECLARED, TOLD, CHANGING, COUNTDOWN }; /* the first two are periodic; a TOLD interval is asked for at the start */

/* An input clock that ticks at times; interval and shift are those of a declared clock, in s. */
typedef struct {
    double interval, shift;
    int32_t clock, kind;
} TimedClock;

/* An input clock that ticks as often as the clocks that drive it: an input has the number of their ticks. */
typedef struct {
    int32_t clock, input;
} TriggeredClock;

/* The ticks of a timed clock, in s; those of a periodic clock are counted, so that rounding errors do not add up. */
typedef struct {
    double next, first, count, interval;
} Ticks;

/* In the memory: times in s, infinite or NaN without, and the present time between steps. */
enum { NEXT_EVENT, END_REQUEST, PRESENT, FIRST_PASSED };

struct Events {
    void *component;
    Function functions[N_EVENT_FUNCTIONS];
    int64_t codes[N_EVENT_FUNCTIONS];  /* in `Activity` */
    const fmi3ValueReference *clocks;  /* output and local clocks first */
    const double *inputs;              /* of the instance */
    const int32_t *discrete;           /* positions of inputs that change in event mode */
    const Call *discrete_setters;
    const ClockedCall *setters, *hand_setters, *getters; /* of clocked variables; inputs set by hand keep their values */
    const ClockSet *needed; /* for each clock: it ticks together with one of these only */
    const TimedClock *timed;
    const TriggeredClock *triggered;
    const int32_t *listed; /* the clocks of all sets */
    int32_t n_clocks, n_output_clocks, n_discrete, n_discrete_setters, n_setters, n_hand_setters, n_getters;
    int32_t n_timed, n_triggered, n_memory;
    int32_t has_event_mode, may_return_early, varies_step;

    double *memory; /* has what follows, from FIRST_PASSED on: */
    double *passed; /* discrete inputs that the FMU has */
    Ticks *schedule;
    double *values; /* of clocked variables, at their last tick */
    double *counts; /* of the ticks of each clock */
    unsigned char *marks; /* room for each clock: what it does in an event */
    fmi3Boolean *active;
    fmi3ValueReference *references;

    double time;         /* present time in s; within a step, that of its part that is under way */
    double first_return; /* time in s of the first early return that is accepted without being declared; NaN without */
    double value;
    int32_t problem, call, status, clock, count;
    int32_t unused;
};

extern STEPPER_API const size_t events_sizes[]; /* of ClockedCall, ClockSet, TimedClock, TriggeredClock, Events */

/* These return what went wrong, or NO_PROBLEM. `activity` can be NULL; times are in s. */

/* Find the first ticks, and get all clocked variables, in initialization mode. */
STEPPER_API int32_t events_start(Activity *activity, Events *events, double time);

/* Enter event mode, in which discrete variables can be set. */
STEPPER_API int32_t events_enter(Activity *activity, Events *events);

/* Update the discrete states until the FMU needs no more of it, and enter step mode. */
STEPPER_API int32_t events_leave(Activity *activity, Events *events);

/* Step from `time` by `length`, and handle the events in between and at the end. */
STEPPER_API int32_t events_step(Activity *activity, Events *events, double time, double length, int32_t has_no_way_back);

#endif
