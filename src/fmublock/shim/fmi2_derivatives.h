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

static fmi2Status check_known(const Instance *instance, fmi2ValueReference reference) {
    if (check_type(instance, reference, 'R') != fmi2OK) return fmi2Error;
    if (variables[reference].access == 'F')
        return report(instance, fmi2Error, "%s is fixed in this FMU.", variables[reference].name);
    const int computed = variables[reference].start_reference >= 0 && instance->now.phase == INITIALIZATION;
    if (reference < FIRST_OUTPUT && !is_discrete_state((int)reference) && !computed) return fmi2OK;
    return report(instance, fmi2Error, "%s is not an input, parameter or state to differentiate by.",
                  variables[reference].name);
}

static fmi2Status check_unknown(const Instance *instance, fmi2ValueReference reference) {
    if (check_type(instance, reference, 'R') != fmi2OK) return fmi2Error;
    if (reference >= FIRST_STATE && !is_discrete_state((int)reference)) return fmi2OK;
    return report(instance, fmi2Error, "%s is not an output, state or derivative to differentiate.",
                  variables[reference].name);
}

/* During initialization at the start values, later at the present time, states and inputs.
 *
 * A known with the seed 0 has no effect. It may be any variable, because OMSimulator lists all dependencies
 * of an unknown here, Integers too.
 */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                        size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                        size_t nKnown, const fmi2Real dvKnown[], fmi2Real dvUnknown[]) {
    Instance *instance = c;
    State *now = &instance->now;
    double direction[ROOM(N_VALUES)] = {0}, tangents[ROOM(N_VALUES)];
    if (require(instance, ~INSTANTIATED, "get directional derivatives") != fmi2OK) return fmi2Error;
    if (check_arrays(instance, nUnknown, vUnknown_ref, dvUnknown) != fmi2OK) return fmi2Error;
    if (check_arrays(instance, nKnown, vKnown_ref, dvKnown) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nUnknown; i++)
        if (check_unknown(instance, vUnknown_ref[i]) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nKnown; i++) {
        if (dvKnown[i] == 0.0 && vKnown_ref[i] < SHOWN(instance)) continue; /* of any type, see below */
        if (check_known(instance, vKnown_ref[i]) != fmi2OK) return fmi2Error;
        direction[vKnown_ref[i]] += dvKnown[i];
    }
    if (now->phase == INITIALIZATION) {
        initialize_values(now);
        for (int r = FIRST_STATE; r < FIRST_OUTPUT; r++)
            if (variables[r].start_reference >= 0) direction[r] = direction[variables[r].start_reference];
    }
    all_tangents(now, 0.0, direction, tangents);
    for (size_t i = 0; i < nUnknown; i++) dvUnknown[i] = tangents[vUnknown_ref[i]];
    return fmi2OK;
}

static fmi2Status require_co_simulation(const Instance *instance, int phases, const char *action) {
    return require(instance, instance->now.type == fmi2CoSimulation ? phases : 0, action);
}

/* Input derivatives apply during the next step only; afterwards an input keeps the value that it has
 * reached.
 */
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    Instance *instance = c;
    const int phases = INSTANTIATED | INITIALIZATION | STEP;
    if (require_co_simulation(instance, phases, "set input derivatives") != fmi2OK) return fmi2Error;
    if (check_arrays(instance, nvr, vr, value) != fmi2OK) return fmi2Error;
    if (check_arrays(instance, nvr, order, value) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        if (check_type(instance, vr[i], 'R') != fmi2OK) return fmi2Error;
        if ((int)vr[i] >= N_INPUTS)
            return report(instance, fmi2Error, "%s is not an input.", variables[vr[i]].name);
        if (order[i] < 1 || order[i] > INPUT_ORDERS)
            return report(instance, fmi2Error, "%s: the order %d of the derivative is not 1 to %d.",
                          variables[vr[i]].name, (int)order[i], INPUT_ORDERS);
    }
#if N_INPUTS > 0
    for (size_t i = 0; i < nvr; i++) {
        instance->now.input_derivatives[vr[i]][order[i] - 1] = value[i];
        instance->now.inputs_move |= value[i] != 0.0;
    }
#endif
    return fmi2OK;
}

/* First time derivatives of the outputs at the last communication point. */
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]) {
    Instance *instance = c;
    double direction[ROOM(N_VALUES)] = {0}, tangents[ROOM(N_VALUES)];
    if (require_co_simulation(instance, STEP | TERMINATED, "get output derivatives") != fmi2OK)
        return fmi2Error;
    if (check_arrays(instance, nvr, vr, value) != fmi2OK) return fmi2Error;
    if (check_arrays(instance, nvr, order, value) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        if (check_unknown(instance, vr[i]) != fmi2OK) return fmi2Error;
        if (vr[i] >= FIRST_DERIVATIVE)
            return report(instance, fmi2Error, "%s is not an output.", variables[vr[i]].name);
        if (order[i] != 1)
            return report(instance, fmi2Error, "%s: the order %d of the derivative is not 1.",
                          variables[vr[i]].name, (int)order[i]);
    }
    State point = instance->now;
    evaluate_derivatives(&point);
    memcpy(point.values, point.held, N_INPUTS * sizeof(double));
    memcpy(direction, point.held_rates, N_INPUTS * sizeof(double));
    for (int i = 0; i < N_STATES; i++) direction[FIRST_STATE + i] = point.values[FIRST_DERIVATIVE + i];
    all_tangents(&point, 1.0, direction, tangents);
    for (size_t i = 0; i < nvr; i++) value[i] = tangents[vr[i]];
    return fmi2OK;
}
