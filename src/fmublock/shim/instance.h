/* One instance of the block: its memory, and its messages to the host. */

#define FIRST_STATE (N_INPUTS + N_PARAMETERS)
#define FIRST_DISCRETE_STATE (FIRST_STATE + N_STATES)
#define FIRST_OUTPUT (FIRST_DISCRETE_STATE + N_DISCRETE_STATES)
#define FIRST_DERIVATIVE (FIRST_OUTPUT + N_OUTPUTS)
#define N_VALUES (FIRST_DERIVATIVE + N_STATES)
#define N_EVOLVING (FIRST_DERIVATIVE - FIRST_STATE)
#define ROOM(n) ((n) > 0 ? (n) : 1) /* C has no empty arrays */

/* Number of values of the variable with this value reference. */
#ifdef HAS_ARRAYS
#define ELEMENTS(reference) (variables[reference].elements)
#else
#define ELEMENTS(reference) ((void)(reference), 1)
#endif

#define INPUT_ORDERS 3 /* polynomials that the internal Runge-Kutta steps integrate exactly */
#define STARTS_AT_START_TIME (-2) /* of start_reference */
#define GUID_SIZE 39 /* {8-4-4-4-12} and the terminating zero */

/* Phases of the FMI state machine are bits, so that a call can name several. */
#define MODEL_EXCHANGE_RUNNING (EVENT | CONTINUOUS_TIME)
#define RUNNING (STEP | CO_SIMULATION_EVENT | MODEL_EXCHANGE_RUNNING)

#include "step_clock.h"

/* All values that evolve or were set; begins with the GUID, so that states of other FMUs are recognized. */
typedef struct {
    char guid[GUID_SIZE];
    int type; /* FOR_CO_SIMULATION or FOR_MODEL_EXCHANGE */
    int phase;
    int inputs_move; /* whether any input derivative is not zero */
#ifdef CLOCK_INTERVAL
    int ticking; /* the clock of the FMU is active */
#endif
    double time, stop_time;
    StepClock clock;
    const double *resource; /* the instance's data, or NULL; not part of serialized or saved states */
    double values[ROOM(N_VALUES)];
    double input_derivatives[ROOM(N_INPUTS)][INPUT_ORDERS]; /* for the next step */
    double held[ROOM(N_INPUTS)];       /* inputs that the present outputs were computed with */
    double held_rates[ROOM(N_INPUTS)]; /* and their time derivatives then */
    double fixed[ROOM(N_FIXED)];       /* values that depend on parameters only */
} State;

typedef struct {
    State now;
    char *name;
    Logger logger;
    Environment environment;
    unsigned logged;         /* categories that are switched on, as bits */
    unsigned char left[ROOM(N_LIMITS)]; /* whether leaving each limit was reported */
    int ended; /* the last step was discarded as it goes past the end of the resource */
    double no_return_before; /* the host said that it will not go back to earlier times */
#ifdef CLOCK_INTERVAL
    State before, shown; /* a tick, and what the host sees */
#endif
#ifdef HAS_INTERMEDIATE_UPDATE
    fmi3IntermediateUpdateCallback intermediate_update; /* or NULL */
    int early_return_allowed, returned_early, requires_any;
    double return_time; /* the host wants the present step to end there */
    unsigned char is_required[ROOM(N_VALUES)]; /* which variables the host reads in the callback */
#endif
} Instance;

#include "messages.h"

/* ---- the resource ---------------------------------------------------------------------- */

/* An FMU with its data in the resources has a header that reads them; its GUID is there, too. */
#ifdef RESOURCE_HEADER
#include RESOURCE_HEADER
#else
#define GUID(state) MODEL_GUID
#define SHOWN(instance) N_VARIABLES
#define RESOURCE_END(state) HUGE_VAL
static Status open_resource(Instance *instance, String location) {
    (void)instance, (void)location;
    return StatusOK;
}
#endif

/* ---- checks ---------------------------------------------------------------------------- */

static const char *phase_name(int phase) {
    for (size_t i = 0; i < sizeof phases / sizeof *phases; i++)
        if (phases[i].bit == phase) return phases[i].name;
    return "unknown";
}

static Status require(const Instance *instance, int phases, const char *action) {
    if (instance->now.phase & phases) return StatusOK;
    return report(instance, StatusError, "cannot %s in phase %s.", action, phase_name(instance->now.phase));
}

static Status check_range(const Instance *instance, int reference) {
    const Variable *variable = &variables[reference];
    const double value = instance->now.values[reference];
    if (variable->minimum <= value && value <= variable->maximum && isfinite(value)) return StatusOK;
    return report(instance, StatusError, "%s = %.9g is outside its range, %.9g to %.9g.", variable->name,
                  value, variable->minimum, variable->maximum);
}

/* Number of digits needed to see that two numbers differ, at least 9. */
static int digits_apart(double a, double b) {
    char texts[2][32];
    for (int digits = 9; digits < 17; digits++) {
        snprintf(texts[0], sizeof texts[0], "%.*g", digits, a);
        snprintf(texts[1], sizeof texts[1], "%.*g", digits, b);
        if (strcmp(texts[0], texts[1]) != 0) return digits;
    }
    return 17;
}

/* Report variables that have left their limits, once each. This is not an error: the call returns StatusOK. */
static void report_limits(Instance *instance) {
    const double *values = instance->now.values;
    for (int i = 0; i < N_LIMITS; i++) {
        const double value = values[limits[i].variable], high = values[limits[i].high];
        const double low = limits[i].low == limits[i].high ? -high : values[limits[i].low];
        if (instance->left[i] || (low <= value && value <= high)) continue;
        instance->left[i] = 1;
        if (variables[limits[i].low].access == 'H' || variables[limits[i].high].access == 'H') {
            report(instance, StatusWarning, "%s = %.9g left its limits at t = %.9g s.",
                   variables[limits[i].variable].name, value, instance->now.time);
            continue;
        }
        const int digits = digits_apart(value, value < low ? low : high);
        report(instance, StatusWarning, "%s = %.*g left its limits, %.9g to %.9g, at t = %.9g s.",
               variables[limits[i].variable].name, digits, value, low, high, instance->now.time);
    }
}

static Status check_exists(const Instance *instance, ValueReference reference) {
    if (reference < SHOWN(instance) && variables[reference].access != 'H' && ELEMENTS(reference) != 0)
        return StatusOK;
    return report(instance, StatusError, "there is no variable with value reference %u.", (unsigned)reference);
}

static Status check_type(const Instance *instance, ValueReference reference, char type) {
    if (reference < SHOWN(instance) && variables[reference].type == type && variables[reference].access != 'H')
        return StatusOK; /* no value inside of an array has a type */
    if (check_exists(instance, reference) != StatusOK) return StatusError;
    const Variable *variable = &variables[reference];
    return report(instance, StatusError, "%s is of type %s.", variable->name, TYPE_NAME(variable->type));
}
