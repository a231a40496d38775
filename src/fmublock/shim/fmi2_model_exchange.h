/* Model Exchange: the host integrates the continuous states.
 *
 * Discrete states stay at their start values: they change once per communication step, and here
 * there is none. The equations have no event indicators: they are continuous in the states, and
 * the host's error control finds their kinks.
 */

static fmi2Status check_size(const Instance *instance, size_t n, size_t expected, const void *array) {
    if (n == expected) return check_arrays(instance, n, array, array);
    return report(instance, fmi2Error, "the array has %u values instead of %u.", (unsigned)n,
                  (unsigned)expected);
}

/* ---- phases ---------------------------------------------------------------------------- */

fmi2Status fmi2EnterEventMode(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, MODEL_EXCHANGE_RUNNING, "enter event mode") != fmi2OK) return fmi2Error;
    instance->now.phase = EVENT;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    Instance *instance = c;
    if (require(instance, EVENT, "find new discrete states") != fmi2OK) return fmi2Error;
    if (check_place(instance, info, "the event information") != fmi2OK) return fmi2Error;
    memset(info, 0, sizeof *info); /* no changes, no events */
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    Instance *instance = c;
    if (require(instance, EVENT, "enter continuous-time mode") != fmi2OK) return fmi2Error;
    instance->now.phase = CONTINUOUS_TIME;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation) {
    Instance *instance = c;
    if (require(instance, CONTINUOUS_TIME, "complete an integrator step") != fmi2OK) return fmi2Error;
    if (check_place(instance, enterEventMode, "enterEventMode") != fmi2OK) return fmi2Error;
    if (check_place(instance, terminateSimulation, "terminateSimulation") != fmi2OK) return fmi2Error;
    if (noSetFMUStatePriorToCurrentPoint) instance->no_return_before = instance->now.time;
    *enterEventMode = fmi2False;
    *terminateSimulation = fmi2False;
    return fmi2OK;
}

/* ---- time and states ------------------------------------------------------------------- */

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    Instance *instance = c;
    if (require(instance, MODEL_EXCHANGE_RUNNING, "set the time") != fmi2OK) return fmi2Error;
    if (!isfinite(time))
        return report(instance, fmi2Error, "the time %g is not a finite number of seconds.", time);
    instance->now.time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx) {
    Instance *instance = c;
    if (require(instance, CONTINUOUS_TIME, "set continuous states") != fmi2OK) return fmi2Error;
    if (check_size(instance, nx, N_STATES, x) != fmi2OK) return fmi2Error;
    if (nx > 0) memcpy(instance->now.values + FIRST_STATE, x, nx * sizeof(double));
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx) {
    Instance *instance = c;
    if (require(instance, ~INSTANTIATED, "get continuous states") != fmi2OK) return fmi2Error;
    if (check_size(instance, nx, N_STATES, x) != fmi2OK) return fmi2Error;
    bring_up_to_date(&instance->now, 0);
    if (nx > 0) memcpy(x, instance->now.values + FIRST_STATE, nx * sizeof(double));
    return fmi2OK;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x_nominal[], size_t nx) {
    Instance *instance = c;
    if (check_size(instance, nx, N_STATES, x_nominal) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nx; i++) x_nominal[i] = variables[FIRST_STATE + i].nominal;
    return fmi2OK;
}

/* A derivative that is not finite is discarded, so that the host can try a shorter step. */
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real x_dot[], size_t nx) {
    Instance *instance = c;
    const State *now = &instance->now;
    if (require(instance, ~INSTANTIATED, "get derivatives") != fmi2OK) return fmi2Error;
    if (check_size(instance, nx, N_STATES, x_dot) != fmi2OK) return fmi2Error;
    bring_up_to_date(&instance->now, 1);
    for (int r = FIRST_DERIVATIVE; r < N_VALUES; r++)
        if (!isfinite(now->values[r]))
            return report(instance, fmi2Discard, "%s at t = %.9g s is %g.", variables[r].name, now->time,
                          now->values[r]);
    if (nx > 0) memcpy(x_dot, now->values + FIRST_DERIVATIVE, nx * sizeof(double));
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real eventIndicators[], size_t ni) {
    return check_size(c, ni, 0, eventIndicators);
}
