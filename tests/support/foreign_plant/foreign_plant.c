/* The actuator as somebody else would model it: an FMI 2.0 co-simulation FMU written from the
 * equations alone, with other names, units, signs and zeros.
 *
 * Values of variables are in the units of modelDescription.xml, everything else is in SI units.
 * Outputs belong to the end of a step with the inputs held over it, and stay until the next one.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define PI 3.14159265358979323846

/* Value references of Real variables: outputs, of which the first are states; parameters; inputs. */
enum {
    POSITION, SPEED, I_Q, I_D, N_STATES,
    MEASURED = N_STATES, ACCELERATION, TORQUE, MOTOR_SPEED, U_Q_OUT, U_D_OUT, SATURATION, MOTOR_POWER,
    LOAD_POWER, I_U, I_V, I_W, I_Q_ERROR, I_Q_SEEN, I_D_SEEN, AVAILABLE,
    FIRST_PARAMETER,
    R_S = FIRST_PARAMETER, L_D, L_Q, FLUX, INERTIA, FRICTION, WINDING, COUPLING_INERTIA, GEARBOX_INERTIA,
    SCREW_TURNS, EFFICIENCY, LEAD, MASS, SCREW_FRICTION, SPRING, RETRACTED, LIMIT, ERROR_MOTION, ERROR_I_Q,
    ERROR_I_D, RESOLUTION, NOISE, SOLVER_STEP, START,
    FIRST_INPUT,
    U_Q = FIRST_INPUT, U_D, I_Q_SETPOINT, FORCE, DISTURBANCE, DISTURBANCE_Q, DISTURBANCE_D, SAG,
    N_REALS
};

/* Value references of Integer variables. */
enum { POLE_PAIRS, SEED, N_INTEGERS };

typedef enum { INSTANTIATED, INITIALIZATION, STEP, TERMINATED } Phase;

/* Everything that was set or evolves. */
typedef struct {
    double reals[N_REALS];
    int integers[N_INTEGERS];
    double x[N_STATES]; /* m from the retracted end, m/s, A, A */
    double time, noise; /* the noise is the present draw from N(0, 1) */
    long long random;   /* state of its generator */
    Phase phase;
} State;

typedef struct {
    State now;
    char *name;
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
} Instance;

static const State start = {
    .reals = {[R_S] = 220.0, [L_D] = 3.1, [L_Q] = 3.4, [FLUX] = 180.0, [INERTIA] = 95.0,
              [FRICTION] = 2.1, [WINDING] = 293.15, [COUPLING_INERTIA] = 4.0, [GEARBOX_INERTIA] = 6.0,
              [SCREW_TURNS] = 0.25, [EFFICIENCY] = 85.0, [LEAD] = 16.0, [MASS] = 75.0,
              [SCREW_FRICTION] = 0.05, [RETRACTED] = 850.0, [LIMIT] = 560.0, [RESOLUTION] = 1000.0,
              [SOLVER_STEP] = 50.0, [START] = 900.0},
    .integers = {[POLE_PAIRS] = 4, [SEED] = 1},
};

/* ---- physics --------------------------------------------------------------------------- */

/* The actuator as its motor sees it: torque = A a + B v + C x - D force. */
typedef struct {
    double R, L_d, L_q, flux, pole_pairs, alpha, A, B, C, D;
} Actuator;

/* What acts on it: voltages after the inverter's limit without and with disturbance, a force that
 * helps extension, and an acceleration. */
typedef struct {
    double u_q, u_d, v_q, v_d, force, acceleration;
    int saturated;
} Drive;

static Actuator actuator(const State *now) {
    const double *v = now->reals;
    const double alpha = 2.0 * PI / (v[SCREW_TURNS] * v[LEAD] * 1e-3); /* motor angle per travel */
    const double J = (v[INERTIA] + v[COUPLING_INERTIA] + v[GEARBOX_INERTIA]) * 1e-4;
    return (Actuator){
        .R = v[R_S] * 1e-3 * (1.0 + 0.00393 * (v[WINDING] - 293.15)), /* copper */
        .L_d = v[L_D] * 1e-3,
        .L_q = v[L_Q] * 1e-3,
        .flux = v[FLUX] * 1e-3,
        .pole_pairs = now->integers[POLE_PAIRS],
        .alpha = alpha,
        .A = alpha * J + v[MASS] / alpha,
        .B = alpha * v[FRICTION] * 1e-3 + v[SCREW_FRICTION] * 1e3 / alpha,
        .C = v[SPRING] * 1e3,
        .D = 1.0 / (alpha * v[EFFICIENCY] * 1e-2),
    };
}

/* Longest voltage vector that the present supply allows. */
static double available(const double v[]) { return v[LIMIT] * (1.0 - v[SAG] * 1e-2); }

static Drive drive(const State *now) {
    const double *v = now->reals, limit = available(v);
    const double demand = sqrt(v[U_Q] * v[U_Q] + v[U_D] * v[U_D]);
    const int saturated = demand > limit * (1.0 + 1e-9); /* by more than rounding */
    const double scale = demand > limit ? limit / demand : 1.0;
    return (Drive){
        .u_q = scale * v[U_Q],
        .u_d = scale * v[U_D],
        .v_q = scale * v[U_Q] + v[DISTURBANCE_Q],
        .v_d = scale * v[U_D] + v[DISTURBANCE_D],
        .force = v[FORCE] * 1e3,
        .acceleration = v[DISTURBANCE] * 1e-3,
        .saturated = saturated,
    };
}

static double magnet_torque(const Actuator *a, const double x[]) {
    return 1.5 * a->pole_pairs * a->flux * x[I_Q];
}

static double reluctance_torque(const Actuator *a, const double x[]) {
    return 1.5 * a->pole_pairs * (a->L_d - a->L_q) * x[I_D] * x[I_Q];
}

/* The errors are those of the friction, spring and reluctance, of the q and of the d axis. */
static void slope(const State *now, const Actuator *a, const Drive *d, const double x[], double dx[]) {
    const double *v = now->reals;
    const double omega = a->pole_pairs * a->alpha * x[SPEED]; /* electrical */
    const double passive = reluctance_torque(a, x) - a->B * x[SPEED] - a->C * x[POSITION];
    const double drop_q = a->R * x[I_Q] + omega * (a->L_d * x[I_D] + a->flux);
    const double drop_d = a->R * x[I_D] - omega * a->L_q * x[I_Q];
    dx[POSITION] = x[SPEED];
    dx[SPEED] = (magnet_torque(a, x) + (1.0 + v[ERROR_MOTION] * 1e-2) * passive + a->D * d->force) / a->A +
                d->acceleration;
    dx[I_Q] = (d->v_q - (1.0 + v[ERROR_I_Q] * 1e-2) * drop_q) / a->L_q;
    dx[I_D] = (d->v_d - (1.0 + v[ERROR_I_D] * 1e-2) * drop_d) / a->L_d;
}

/* Classical Runge-Kutta steps of equal length, none longer than the solver's step. */
static void integrate(State *now, double step) {
    static const double nodes[] = {0.0, 0.5, 0.5, 1.0}, weights[] = {1.0, 2.0, 2.0, 1.0};
    const Actuator a = actuator(now);
    const Drive d = drive(now);
    /* a step may be longer than a multiple of the solver's step by rounding only */
    const double count = fmax(1.0, ceil(step / (now->reals[SOLVER_STEP] * 1e-6) - 1e-9));
    const double dt = step / count;
    for (double n = 0.0; n < count; n++) {
        double x[N_STATES], dx[N_STATES] = {0.0}, sum[N_STATES] = {0.0};
        for (int stage = 0; stage < 4; stage++) {
            for (int i = 0; i < N_STATES; i++) x[i] = now->x[i] + nodes[stage] * dt * dx[i];
            slope(now, &a, &d, x, dx);
            for (int i = 0; i < N_STATES; i++) sum[i] += weights[stage] * dx[i];
        }
        for (int i = 0; i < N_STATES; i++) now->x[i] += dt / 6.0 * sum[i];
    }
}

/* Park and Miller's generator, two draws of which make one from N(0, 1) (Box and Muller). */
static double uniform(State *now) {
    now->random = 16807 * now->random % 2147483647;
    return (double)now->random / 2147483647.0;
}

static void draw_noise(State *now) {
    const double radius = sqrt(-2.0 * log(uniform(now)));
    now->noise = radius * cos(2.0 * PI * uniform(now));
}

/* ---- values of variables --------------------------------------------------------------- */

static double rounded(double x, double resolution) {
    return resolution > 0.0 ? resolution * floor(x / resolution + 0.5) : x;
}

/* Current of the phase whose winding lies at an electrical angle. */
static double phase_current(const Actuator *a, const double x[], double winding) {
    const double angle = a->pole_pairs * a->alpha * x[POSITION] - winding;
    return x[I_D] * cos(angle) - x[I_Q] * sin(angle);
}

static void write_outputs(State *now) {
    double *v = now->reals, dx[N_STATES];
    const double *x = now->x;
    const Actuator a = actuator(now);
    const Drive d = drive(now);
    const double seen = x[POSITION] + v[NOISE] * 1e-6 * now->noise;
    slope(now, &a, &d, x, dx);
    v[MEASURED] = v[RETRACTED] + rounded(seen, v[RESOLUTION] * 1e-9) * 1e3;
    v[ACCELERATION] = dx[SPEED] * 1e3;
    v[TORQUE] = magnet_torque(&a, x) + reluctance_torque(&a, x);
    v[MOTOR_SPEED] = a.alpha * x[SPEED] * 30.0 / PI;
    v[U_Q_OUT] = d.u_q;
    v[U_D_OUT] = d.u_d;
    v[SATURATION] = d.saturated;
    v[MOTOR_POWER] = 1.5 * (d.v_q * x[I_Q] + d.v_d * x[I_D]) * 1e-3;
    v[LOAD_POWER] = -d.force * x[SPEED] * 1e-3;
    v[I_U] = phase_current(&a, x, 0.0);
    v[I_V] = phase_current(&a, x, 2.0 * PI / 3.0);
    v[I_W] = phase_current(&a, x, -2.0 * PI / 3.0);
    v[I_Q_ERROR] = v[I_Q_SETPOINT] - x[I_Q];
    v[I_Q_SEEN] = x[I_Q];
    v[I_D_SEEN] = x[I_D];
    v[AVAILABLE] = available(v);
}

static void write_states(State *now) {
    now->reals[POSITION] = now->reals[RETRACTED] + now->x[POSITION] * 1e3;
    now->reals[SPEED] = now->x[SPEED] * 1e3;
    now->reals[I_Q] = now->x[I_Q];
    now->reals[I_D] = now->x[I_D];
}

/* In initialization mode states and outputs follow from what has been set so far. */
static void initialize(State *now) {
    now->reals[POSITION] = now->reals[START];
    now->x[POSITION] = (now->reals[START] - now->reals[RETRACTED]) * 1e-3;
    now->x[SPEED] = now->reals[SPEED] * 1e-3;
    now->x[I_Q] = now->reals[I_Q];
    now->x[I_D] = now->reals[I_D];
    now->random = now->integers[SEED];
    write_outputs(now);
    now->reals[AVAILABLE] = now->reals[LIMIT]; /* sampled by steps, so that it waits for no input */
}

/* ---- instances ------------------------------------------------------------------------- */

static fmi2Status say(const Instance *instance, fmi2Status status, const char *message) {
    const char *category = status == fmi2Discard ? "logStatusDiscard" : "logStatusError";
    if (instance->logger != NULL)
        instance->logger(instance->environment, instance->name, status, category, message);
    return status;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
    Instance *instance;
    if (fmuType != fmi2CoSimulation || strcmp(fmuGUID, MODEL_GUID) != 0) return NULL;
    if ((instance = calloc(1, sizeof *instance)) == NULL) return NULL;
    instance->now = start;
    instance->logger = functions->logger;
    instance->environment = functions->componentEnvironment;
    if ((instance->name = malloc(strlen(instanceName) + 1)) != NULL) {
        strcpy(instance->name, instanceName);
        return instance;
    }
    free(instance);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *instance = c;
    if (instance == NULL) return;
    free(instance->name);
    free(instance);
}

/* Only failures are logged, and they always are. */
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[]) {
    return fmi2OK;
}

/* ---- initialize, terminate, reset ------------------------------------------------------ */

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    ((Instance *)c)->now.time = startTime;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    State *now = &((Instance *)c)->now;
    if (now->phase != INSTANTIATED) return say(c, fmi2Error, "The actuator is initialized already.");
    now->phase = INITIALIZATION;
    initialize(now);
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    State *now = &((Instance *)c)->now;
    if (now->phase != INITIALIZATION) return say(c, fmi2Error, "The actuator is not being initialized.");
    now->phase = STEP;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
    ((Instance *)c)->now.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    ((Instance *)c)->now = start;
    return fmi2OK;
}

/* ---- get and set ----------------------------------------------------------------------- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    const State *now = &((Instance *)c)->now;
    for (size_t i = 0; i < nvr; i++) {
        if (vr[i] >= N_REALS) return say(c, fmi2Error, "There is no such Real variable.");
        value[i] = now->reals[vr[i]];
    }
    return fmi2OK;
}

/* Inputs can always be set, parameters and the start values of states until steps begin. The position
 * starts from a parameter. */
static int is_settable(const State *now, fmi2ValueReference vr) {
    const int is_input = vr >= FIRST_INPUT;
    const int is_calculated = vr == POSITION || (vr >= N_STATES && vr < FIRST_PARAMETER);
    return vr < N_REALS && (is_input || (now->phase < STEP && !is_calculated));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    State *now = &((Instance *)c)->now;
    for (size_t i = 0; i < nvr; i++) {
        if (!is_settable(now, vr[i])) return say(c, fmi2Error, "This Real variable cannot be set now.");
        now->reals[vr[i]] = value[i];
    }
    if (now->phase == INITIALIZATION) initialize(now);
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    const State *now = &((Instance *)c)->now;
    for (size_t i = 0; i < nvr; i++) {
        if (vr[i] >= N_INTEGERS) return say(c, fmi2Error, "There is no such Integer variable.");
        value[i] = now->integers[vr[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Integer value[]) {
    State *now = &((Instance *)c)->now;
    for (size_t i = 0; i < nvr; i++) {
        if (vr[i] >= N_INTEGERS || now->phase >= STEP)
            return say(c, fmi2Error, "This Integer variable cannot be set now.");
        now->integers[vr[i]] = value[i];
    }
    if (now->phase == INITIALIZATION) initialize(now);
    return fmi2OK;
}

/* ---- steps ----------------------------------------------------------------------------- */

static int is_finite(const State *now) {
    for (int i = 0; i < N_REALS; i++)
        if (!isfinite(now->reals[i])) return 0;
    return 1;
}

/* A step that leaves the finite numbers is taken back. */
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    State *now = &((Instance *)c)->now;
    const State before = *now;
    if (now->phase != STEP) return say(c, fmi2Error, "The actuator is not ready for steps.");
    if (!(communicationStepSize > 0.0)) return say(c, fmi2Error, "The step size is not positive.");
    integrate(now, communicationStepSize);
    draw_noise(now);
    now->time = currentCommunicationPoint + communicationStepSize;
    write_states(now);
    write_outputs(now);
    if (is_finite(now)) return fmi2OK;
    *now = before;
    return say(c, fmi2Discard, "The step does not end in finite numbers.");
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    if (s != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((Instance *)c)->now.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    if (s != fmi2Terminated) return fmi2Discard;
    *value = fmi2False; /* the actuator never ends a run */
    return fmi2OK;
}

/* ---- FMU states ------------------------------------------------------------------------ */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    if (*FMUstate == NULL && (*FMUstate = malloc(sizeof(State))) == NULL)
        return say(c, fmi2Error, "There is no memory for a state.");
    *(State *)*FMUstate = ((Instance *)c)->now;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    ((Instance *)c)->now = *(State *)FMUstate;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    free(*FMUstate);
    *FMUstate = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    *size = sizeof(State);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                 size_t size) {
    if (size < sizeof(State)) return say(c, fmi2Error, "There is no room for a state.");
    memcpy(serializedState, FMUstate, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    if (size != sizeof(State)) return say(c, fmi2Error, "This is not a state.");
    if (*FMUstate == NULL && (*FMUstate = malloc(sizeof(State))) == NULL)
        return say(c, fmi2Error, "There is no memory for a state.");
    memcpy(*FMUstate, serializedState, sizeof(State));
    return fmi2OK;
}

/* ---- what this FMU does not have ------------------------------------------------------- */

static fmi2Status without(fmi2Component c, size_t n) {
    return n == 0 ? fmi2OK : say(c, fmi2Error, "The actuator does not have this.");
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    return without(c, nvr);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Boolean value[]) {
    return without(c, nvr);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
    return without(c, nvr);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[]) {
    return without(c, nvr);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    return without(c, nvr);
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]) {
    return without(c, nvr);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                        size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                        size_t nKnown, const fmi2Real dvKnown[], fmi2Real dvUnknown[]) {
    return without(c, nUnknown);
}

fmi2Status fmi2CancelStep(fmi2Component c) { return say(c, fmi2Error, "No step is pending."); }

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) { return fmi2Discard; }

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    return fmi2Discard;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    return fmi2Discard;
}
