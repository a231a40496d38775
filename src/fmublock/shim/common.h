/* Functions that co-simulation and Model Exchange share: create, initialize, get and set. */

const char *FMI(GetVersion)(void) { return FMI(Version); }

/* ---- create and free ------------------------------------------------------------------- */

static Status check_identity(const Instance *instance, String name, int type, String guid) {
    if (name == NULL || *name == '\0')
        return report(instance, StatusError, "an instance needs a name; this one is %s.",
                      name == NULL ? "NULL" : "empty");
#ifndef MODEL_EXCHANGE
    if (type == FOR_MODEL_EXCHANGE)
        return report(instance, StatusError, "this FMU is for co-simulation only.");
#endif
    if (type != FOR_CO_SIMULATION && type != FOR_MODEL_EXCHANGE)
        return report(instance, StatusError, "there is no FMU type %d.", type);
    if (guid == NULL || strcmp(guid, GUID(&instance->now)) != 0)
        return report(instance, StatusError, "the " TOKEN_NAME " %.100s is not this FMU's, %s.",
                      guid == NULL ? "(none)" : guid, GUID(&instance->now));
    return StatusOK;
}

/* Return a new instance, or NULL after a message. */
static Handle create_instance(String name, String guid, String resources, int type, Boolean logging, Logger logger,
                              Environment environment) {
    const char *own_name = name != NULL && *name ? name : MODEL_IDENTIFIER;
    Instance *instance = calloc(1, sizeof *instance);
    char *copy = malloc(strlen(own_name) + 1);
    if (instance == NULL || copy == NULL) {
        free(instance);
        free(copy);
        return NULL;
    }
    instance->name = strcpy(copy, own_name);
    instance->logger = logger;
    instance->environment = environment;
    instance->logged = logging ? EVERYTHING : PROBLEMS;
    instance->no_return_before = -HUGE_VAL;
    if (open_resource(instance, resources) == StatusOK) {
        set_start_values(&instance->now, type);
        if (check_identity(instance, name, type, guid) == StatusOK) return instance;
    }
    FMI(FreeInstance)(instance);
    return NULL;
}

void FMI(FreeInstance)(Handle c) {
    Instance *instance = c;
    if (instance == NULL) return;
    free((void *)instance->now.resource);
    free(instance->name);
    free(instance);
}

/* ---- logging --------------------------------------------------------------------------- */

#include "logging.h"

/* ---- initialize, terminate, reset ------------------------------------------------------ */

static Status set_experiment(Instance *instance, Boolean toleranceDefined, double tolerance, double startTime,
                             Boolean stopTimeDefined, double stopTime) {
    if (check_experiment(instance, toleranceDefined, tolerance, startTime, stopTimeDefined, stopTime) != StatusOK)
        return StatusError;
    instance->now.time = startTime;
    instance->now.stop_time = stopTimeDefined ? stopTime : HUGE_VAL;
    if (toleranceDefined && instance->now.type == FOR_CO_SIMULATION)
        report(instance, StatusOK, "tolerance %g ignored; solver.internal_step sets the accuracy.", tolerance);
    return StatusOK;
}

/* Check the block's conditions on its values, beside their ranges. */
static Status check_conditions(const Instance *instance) {
#if N_CONDITIONS > 0
    double holds[N_CONDITIONS];
    conditions(instance->now.time, instance->now.values, FIXED(&instance->now), holds);
    for (int i = 0; i < N_CONDITIONS; i++)
        if (holds[i] == 0.0) return report(instance, StatusError, "%s.", demands[i]);
#else
    (void)instance;
#endif
    return StatusOK;
}

static Status check_substeps(const Instance *instance, double step) {
    if (substeps(&instance->now, step) <= MAXIMUM_SUBSTEPS) return StatusOK;
    return report(instance, StatusError, "the step of %g s needs more than %g internal steps.", step,
                  MAXIMUM_SUBSTEPS);
}

Status FMI(ExitInitializationMode)(Handle c) {
    Instance *instance = c;
    State *now = &instance->now;
    if (require(instance, INITIALIZATION, "exit initialization mode") != StatusOK) return StatusError;
    take_start_values(now);
    for (int r = N_INPUTS; r < FIRST_DISCRETE_STATE; r++)
        if (check_range(instance, r) != StatusOK) return StatusError;
    fix_values(now);
    if (check_conditions(instance) != StatusOK) return StatusError;
#ifdef CLOCK_INTERVAL
    if (check_substeps(instance, CLOCK_INTERVAL) != StatusOK) return StatusError;
#endif
    evaluate_outputs(now);
    hold_inputs(now, 0.0);
    now->phase = now->type == FOR_MODEL_EXCHANGE ? EVENT : STEP;
#ifdef CLOCK_INTERVAL
    now->phase = CO_SIMULATION_EVENT;
    start_clock(now);
#endif
    report_limits(instance);
    return report(instance, StatusOK, "initialized at t = %.9g s.", now->time);
}

Status FMI(Terminate)(Handle c) {
    Instance *instance = c;
    if (require(instance, RUNNING, "terminate") != StatusOK) return StatusError;
    instance->now.phase = TERMINATED;
    return report(instance, StatusOK, "terminated at t = %.9g s.", instance->now.time);
}

Status FMI(Reset)(Handle c) {
    Instance *instance = c;
    if (require(instance, ~INTERMEDIATE_UPDATE, "reset") != StatusOK) return StatusError;
    set_start_values(&instance->now, instance->now.type);
    instance->no_return_before = -HUGE_VAL;
    memset(instance->left, 0, sizeof instance->left);
    instance->ended = 0;
    return StatusOK;
}

/* ---- get ------------------------------------------------------------------------------- */

/* Bring the requested values up to the present time. */
static void bring_up_to_date(State *now, int derivatives_asked) {
    if (now->phase == INITIALIZATION) initialize_values(now);
    if (now->phase & MODEL_EXCHANGE_RUNNING) evaluate_outputs(now);
    if (derivatives_asked) evaluate_derivatives(now);
}

/* Check that the host has as many values as the variables, which may be arrays. */
static Status check_total(const Instance *instance, size_t expected, size_t n) {
    if (n == expected) return StatusOK;
    return report(instance, StatusError, "%u values were announced for variables of %u values.", (unsigned)n,
                  (unsigned)expected);
}

static Status check_count(const Instance *instance, const ValueReference vr[], size_t nvr, size_t n) {
    size_t expected = 0;
    for (size_t i = 0; i < nvr; i++) expected += (size_t)ELEMENTS(vr[i]);
    return check_total(instance, expected, n);
}

/* Check all references of a call before reading any value. */
static Status prepare_get(Instance *instance, const ValueReference vr[], size_t nvr, char type, const void *values,
                          size_t n) {
    int derivatives_asked = 0;
    size_t expected = 0;
    if (require(instance, ~INSTANTIATED, "get values") != StatusOK) return StatusError;
    if (check_arrays(instance, nvr, vr, values) != StatusOK) return StatusError;
    for (size_t i = 0; i < nvr; i++) {
        if (check_type(instance, vr[i], type) != StatusOK) return StatusError;
#ifdef CLOCK_INTERVAL
        if (check_clocked(instance, vr[i]) != StatusOK) return StatusError;
#endif
        derivatives_asked |= vr[i] >= FIRST_DERIVATIVE;
        expected += (size_t)ELEMENTS(vr[i]);
    }
    if (check_required(instance, vr, nvr) != StatusOK) return StatusError;
    if (check_total(instance, expected, n) != StatusOK) return StatusError;
    if (nvr > 0) bring_up_to_date(&instance->now, derivatives_asked);
#ifdef CLOCK_INTERVAL
    if (show(instance) != StatusOK) return StatusError;
#endif
    return StatusOK;
}

static double current_value(const State *now, ValueReference reference) {
    return reference < N_VALUES ? now->values[reference] : now->time;
}

/* ---- set ------------------------------------------------------------------------------- */

static Status check_settable(const Instance *instance, int reference) {
    const Variable *variable = &variables[reference];
    const int phase = instance->now.phase;
    if (variable->access == 'F')
        return report(instance, StatusError, "%s is fixed in this FMU and cannot be set.", variable->name);
    if (reference >= FIRST_OUTPUT || variable->start_reference != -1)
        return report(instance, StatusError, "%s is computed by the block and cannot be set.", variable->name);
    if (reference >= N_INPUTS && !(phase & (INSTANTIATED | INITIALIZATION)))
        return report(instance, StatusError, "%s cannot be set after initialization.", variable->name);
    if (phase == CONTINUOUS_TIME && variable->type != 'R')
        return report(instance, StatusError, "%s can be set at events only.", variable->name);
    return StatusOK;
}

/* Check all references of a call, so that a refused call changes nothing. */
static Status prepare_set(Instance *instance, const ValueReference vr[], size_t nvr, char type, const void *values,
                          size_t n) {
    if (require(instance, ~(TERMINATED | INTERMEDIATE_UPDATE), "set values") != StatusOK) return StatusError;
    if (check_arrays(instance, nvr, vr, values) != StatusOK) return StatusError;
    size_t expected = 0;
    for (size_t i = 0; i < nvr; i++) {
        if (check_type(instance, vr[i], type) != StatusOK || check_settable(instance, (int)vr[i]) != StatusOK)
            return StatusError;
#ifdef CLOCK_INTERVAL
        if (check_clocked(instance, vr[i]) != StatusOK) return StatusError;
#endif
        expected += (size_t)ELEMENTS(vr[i]);
    }
    return check_total(instance, expected, n);
}

/* ---- the types ------------------------------------------------------------------------- */

/* The first loop ends after the last array, when each of the remaining variables has one value. */
#define GET_AND_SET(Name, Type, letter, from_double, to_double)                                              \
    Status FMI(Get##Name)(Handle c, const ValueReference vr[], size_t nvr, Type values[] COUNTED(n)) {       \
        Instance *instance = c;                                                                              \
        size_t i = 0, k = 0;                                                                                 \
        if (prepare_get(instance, vr, nvr, letter, values, COUNT_OF(n, nvr)) != StatusOK) return StatusError;\
        for (; COUNT_OF(n, nvr) - k > nvr - i; i++)                                                          \
            for (int j = 0; j < ELEMENTS(vr[i]); j++)                                                        \
                values[k++] = from_double(current_value(SEEN(instance), vr[i] + (ValueReference)j));         \
        for (; i < nvr; i++) values[k++] = from_double(current_value(SEEN(instance), vr[i]));                \
        return StatusOK;                                                                                     \
    }                                                                                                        \
    Status FMI(Set##Name)(Handle c, const ValueReference vr[], size_t nvr, const Type values[] COUNTED(n)) { \
        Instance *instance = c;                                                                              \
        size_t i = 0, k = 0;                                                                                 \
        if (prepare_set(instance, vr, nvr, letter, values, COUNT_OF(n, nvr)) != StatusOK) return StatusError;\
        for (; COUNT_OF(n, nvr) - k > nvr - i; i++)                                                          \
            for (int j = 0; j < ELEMENTS(vr[i]); j++)                                                        \
                instance->now.values[(int)vr[i] + j] = to_double(values[k++]);                               \
        for (; i < nvr; i++) instance->now.values[vr[i]] = to_double(values[k++]);                           \
        return StatusOK;                                                                                     \
    }

#include "conversions.h"
