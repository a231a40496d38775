/* Model Exchange: the host integrates the continuous states.
 *
 * Discrete states stay at their start values: they change once per communication step, and here
 * there is none. The equations have no event indicators: they are continuous in the states, and
 * the host's error control finds their kinks.
 */

static Status check_size(const Instance *instance, size_t n, size_t expected, const void *array) {
    if (n == expected) return check_arrays(instance, n, array, array);
    return report(instance, StatusError, "the array has %u values instead of %u.", (unsigned)n,
                  (unsigned)expected);
}

/* ---- phases ---------------------------------------------------------------------------- */

Status FMI(EnterEventMode)(Handle c) {
    Instance *instance = c;
#ifdef CLOCK_INTERVAL
    const int before = STEP, after = CO_SIMULATION_EVENT;
#else
    const int before = MODEL_EXCHANGE_RUNNING, after = EVENT;
#endif
    if (require(instance, before, "enter event mode") != StatusOK) return StatusError;
    instance->now.phase = after;
    return StatusOK;
}

Status FMI(EnterContinuousTimeMode)(Handle c) {
    Instance *instance = c;
    if (require(instance, EVENT, "enter continuous-time mode") != StatusOK) return StatusError;
    instance->now.phase = CONTINUOUS_TIME;
    return StatusOK;
}

Status FMI(CompletedIntegratorStep)(Handle c, Boolean noSetFMUStatePriorToCurrentPoint,
                                       Boolean *enterEventMode, Boolean *terminateSimulation) {
    Instance *instance = c;
    if (require(instance, CONTINUOUS_TIME, "complete an integrator step") != StatusOK) return StatusError;
    if (check_place(instance, enterEventMode, "enterEventMode") != StatusOK) return StatusError;
    if (check_place(instance, terminateSimulation, "terminateSimulation") != StatusOK) return StatusError;
    if (noSetFMUStatePriorToCurrentPoint) instance->no_return_before = instance->now.time;
    *enterEventMode = 0;
    *terminateSimulation = 0;
    return StatusOK;
}

/* ---- time and states ------------------------------------------------------------------- */

Status FMI(SetTime)(Handle c, double time) {
    Instance *instance = c;
    if (require(instance, MODEL_EXCHANGE_RUNNING, "set the time") != StatusOK) return StatusError;
    if (!isfinite(time))
        return report(instance, StatusError, "the time %g is not a finite number of seconds.", time);
    instance->now.time = time;
    return StatusOK;
}

Status FMI(SetContinuousStates)(Handle c, const double x[], size_t nx) {
    Instance *instance = c;
    if (require(instance, CONTINUOUS_TIME, "set continuous states") != StatusOK) return StatusError;
    if (check_size(instance, nx, N_STATES, x) != StatusOK) return StatusError;
    if (nx > 0) memcpy(instance->now.values + FIRST_STATE, x, nx * sizeof(double));
    return StatusOK;
}

Status FMI(GetContinuousStates)(Handle c, double x[], size_t nx) {
    Instance *instance = c;
    if (require(instance, ~INSTANTIATED, "get continuous states") != StatusOK) return StatusError;
    if (check_size(instance, nx, N_STATES, x) != StatusOK) return StatusError;
    bring_up_to_date(&instance->now, 0);
    if (nx > 0) memcpy(x, instance->now.values + FIRST_STATE, nx * sizeof(double));
    return StatusOK;
}

Status FMI(GetNominalsOfContinuousStates)(Handle c, double x_nominal[], size_t nx) {
    Instance *instance = c;
    if (check_size(instance, nx, N_STATES, x_nominal) != StatusOK) return StatusError;
    for (size_t i = 0; i < nx; i++) x_nominal[i] = variables[FIRST_STATE + i].nominal;
    return StatusOK;
}

/* A derivative that is not finite is discarded, so that the host can try a shorter step. */
Status FMI(GetContinuousStateDerivatives)(Handle c, double x_dot[], size_t nx) {
    Instance *instance = c;
    const State *now = &instance->now;
    if (require(instance, ~INSTANTIATED, "get derivatives") != StatusOK) return StatusError;
    if (check_size(instance, nx, N_STATES, x_dot) != StatusOK) return StatusError;
    bring_up_to_date(&instance->now, 1);
    for (int r = FIRST_DERIVATIVE; r < N_VALUES; r++)
        if (!isfinite(now->values[r]))
            return report(instance, StatusDiscard, "%s at t = %.9g s is %g.", variables[r].name, now->time,
                          now->values[r]);
    if (nx > 0) memcpy(x_dot, now->values + FIRST_DERIVATIVE, nx * sizeof(double));
    return StatusOK;
}

Status FMI(GetEventIndicators)(Handle c, double eventIndicators[], size_t ni) {
    return check_size(c, ni, 0, eventIndicators);
}
