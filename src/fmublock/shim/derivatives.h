/* Derivatives in a direction, and time derivatives of inputs and outputs.
 *
 * All of them are exact: the tangents are generated from the equations.
 */

/* Derivatives of all computed values when time and values change in a direction. */
static void all_tangents(const State *now, double time_direction, const double *direction, double *tangents) {
    memcpy(tangents, direction, FIRST_OUTPUT * sizeof(double));
    const double *v = now->values, *fixed = FIXED(now);
    outputs_tangent(now->time, v, fixed, time_direction, direction, tangents + FIRST_OUTPUT);
    derivatives_tangent(now->time, v, fixed, time_direction, direction, tangents + FIRST_DERIVATIVE);
}

static int is_discrete_state(int reference) {
    return reference >= FIRST_DISCRETE_STATE && reference < FIRST_OUTPUT;
}

static Status check_known(const Instance *instance, ValueReference reference) {
    if (check_type(instance, reference, 'R') != StatusOK) return StatusError;
    if (variables[reference].access == 'F')
        return report(instance, StatusError, "%s is fixed in this FMU.", variables[reference].name);
    const int computed = variables[reference].start_reference >= 0 && instance->now.phase == INITIALIZATION;
    if (reference < FIRST_OUTPUT && !is_discrete_state((int)reference) && !computed) return StatusOK;
    return report(instance, StatusError, "%s is not an input, parameter or state to differentiate by.",
                  variables[reference].name);
}

static Status check_unknown(const Instance *instance, ValueReference reference) {
    if (check_type(instance, reference, 'R') != StatusOK) return StatusError;
    if (reference >= FIRST_STATE && reference < N_VALUES && !is_discrete_state((int)reference)) return StatusOK;
    return report(instance, StatusError, "%s is not an output, state or derivative to differentiate.",
                  variables[reference].name);
}

/* During initialization at the start values, later at the present time, states and inputs. */
static void tangents_here(State *now, double *direction, double *tangents) {
    if (now->phase == INITIALIZATION) {
        initialize_values(now);
        for (int r = FIRST_STATE; r < FIRST_OUTPUT; r++)
            if (variables[r].start_reference >= 0) direction[r] = direction[variables[r].start_reference];
    }
    all_tangents(now, 0.0, direction, tangents);
}

/* A known with the seed 0 has no effect. It may be any variable, because OMSimulator lists all dependencies
 * of an unknown here, Integers too.
 */
Status FMI(GetDirectionalDerivative)(Handle c, const ValueReference unknowns[], size_t nUnknowns,
                                     const ValueReference knowns[], size_t nKnowns,
                                     const double seed[] COUNTED(nSeed),
                                     double sensitivity[] COUNTED(nSensitivity)) {
    Instance *instance = c;
    double direction[ROOM(N_VALUES)] = {0}, tangents[ROOM(N_VALUES)];
    if (require(instance, ~(INSTANTIATED | INTERMEDIATE_UPDATE), "get directional derivatives") != StatusOK) return StatusError;
    if (check_arrays(instance, nUnknowns, unknowns, sensitivity) != StatusOK) return StatusError;
    if (check_arrays(instance, nKnowns, knowns, seed) != StatusOK) return StatusError;
    for (size_t i = 0; i < nUnknowns; i++)
        if (check_unknown(instance, unknowns[i]) != StatusOK) return StatusError;
    if (check_count(instance, unknowns, nUnknowns, COUNT_OF(nSensitivity, nUnknowns)) != StatusOK)
        return StatusError;
    for (size_t i = 0; i < nKnowns; i++)
        if (check_exists(instance, knowns[i]) != StatusOK) return StatusError;
    if (check_count(instance, knowns, nKnowns, COUNT_OF(nSeed, nKnowns)) != StatusOK) return StatusError;
    for (size_t i = 0, k = 0; i < nKnowns; i++)
        for (int j = 0; j < ELEMENTS(knowns[i]); j++, k++) {
            if (seed[k] == 0.0) continue; /* of any type, see above */
            if (check_known(instance, knowns[i]) != StatusOK) return StatusError;
            direction[(int)knowns[i] + j] += seed[k];
        }
    tangents_here(&instance->now, direction, tangents);
    for (size_t i = 0, k = 0; i < nUnknowns; i++)
        for (int j = 0; j < ELEMENTS(unknowns[i]); j++) sensitivity[k++] = tangents[(int)unknowns[i] + j];
    return StatusOK;
}

static Status require_co_simulation(const Instance *instance, int phases, const char *action) {
    return require(instance, instance->now.type == FOR_CO_SIMULATION ? phases : 0, action);
}

/* First time derivatives of the outputs at the last communication point. */
Status FMI(GetOutputDerivatives)(Handle c, const ValueReference vr[], size_t nvr, const Integer order[],
                                 double value[] COUNTED(n)) {
    Instance *instance = c;
    double direction[ROOM(N_VALUES)] = {0}, tangents[ROOM(N_VALUES)];
    const int phases = STEP | TERMINATED | INTERMEDIATE_UPDATE, is_between = instance->now.phase == INTERMEDIATE_UPDATE;
    if (require_co_simulation(instance, phases, "get output derivatives") != StatusOK) return StatusError;
    if (check_arrays(instance, nvr, vr, value) != StatusOK) return StatusError;
    if (check_arrays(instance, nvr, order, value) != StatusOK) return StatusError;
    for (size_t i = 0; i < nvr; i++) {
        if (check_unknown(instance, vr[i]) != StatusOK) return StatusError;
        const char *name = variables[vr[i]].name;
        if (vr[i] >= FIRST_DERIVATIVE) return report(instance, StatusError, "%s is not an output.", name);
        if (order[i] != 1)
            return report(instance, StatusError, "%s: the order %d of the derivative is not 1.", name, (int)order[i]);
    }
    if (check_required(instance, vr, nvr) != StatusOK) return StatusError;
    if (check_count(instance, vr, nvr, COUNT_OF(n, nvr)) != StatusOK) return StatusError;
    State point = instance->now;
    evaluate_derivatives(&point);
    if (!is_between) { /* then the inputs are those of the step already, and do not move in FMI 3.0 */
        memcpy(point.values, point.held, N_INPUTS * sizeof(double));
        memcpy(direction, point.held_rates, N_INPUTS * sizeof(double));
    }
    for (int i = 0; i < N_STATES; i++) direction[FIRST_STATE + i] = point.values[FIRST_DERIVATIVE + i];
    all_tangents(&point, 1.0, direction, tangents);
    for (size_t i = 0, k = 0; i < nvr; i++)
        for (int j = 0; j < ELEMENTS(vr[i]); j++) value[k++] = tangents[(int)vr[i] + j];
    return StatusOK;
}
