/* Intermediate update: after each internal step the host can read outputs, and end the communication step there.
 *
 * Inputs and discrete states are those of the communication step. Its last internal step includes its end, so that
 * the host then reads what it reads after the step.
 */

/* Outputs and states that change continuously. */
static int is_intermediate(int reference) {
#ifdef CLOCK_INTERVAL
    (void)reference;
    return 0;
#else
    const int is_state = reference >= FIRST_STATE && reference < FIRST_DISCRETE_STATE;
    const int is_output = reference >= FIRST_OUTPUT && reference < FIRST_DERIVATIVE;
    return (is_state || is_output) && variables[reference].type == 'R';
#endif
}

/* Remember the callback, and which variables the host will read in it. */
static Status use_intermediate_update(Instance *instance, fmi3IntermediateUpdateCallback callback,
                                      Boolean early_return_allowed, const ValueReference required[], size_t n) {
    if (check_arrays(instance, n, required, required) != StatusOK) return StatusError;
    for (size_t i = 0; i < n; i++) {
        if (check_exists(instance, required[i]) != StatusOK) return StatusError;
        if (!is_intermediate((int)required[i]))
            return report(instance, StatusError, "%s has no intermediate update.", variables[required[i]].name);
        instance->is_required[required[i]] = 1;
        instance->requires_any = 1;
    }
#ifndef CLOCK_INTERVAL
    instance->intermediate_update = callback;
#else
    (void)callback;
#endif
    instance->early_return_allowed = early_return_allowed;
    return StatusOK;
}

/* Check that the host reads only these variables in the callback. All of the references exist. */
static Status check_required(const Instance *instance, const ValueReference vr[], size_t nvr) {
    if (instance->now.phase != INTERMEDIATE_UPDATE) return StatusOK;
    for (size_t i = 0; i < nvr; i++)
        if (vr[i] >= N_VALUES || !instance->is_required[vr[i]])
            return report(instance, StatusError, "%s is not among requiredIntermediateVariables.",
                          variables[vr[i]].name);
    return StatusOK;
}

static void begin_intermediate_updates(Instance *instance) {
    instance->return_time = HUGE_VAL;
    instance->returned_early = 0;
}

/* Call the host with the present values. */
RARE static void update_intermediately(Instance *instance, double time, int can_return) {
    State *now = &instance->now;
    const double before = now->time;
    fmi3Boolean requested = fmi3False;
    fmi3Float64 return_time = time;
    now->time = time;
    now->phase = INTERMEDIATE_UPDATE;
    instance->intermediate_update(instance->environment, time, fmi3False, instance->requires_any != 0, fmi3True,
                                  can_return != 0, &requested, &return_time);
    now->phase = STEP;
    now->time = before;
    if (can_return && requested) instance->return_time = return_time;
}

/* Whether the host ends the communication step at this time; otherwise an internal step to the next time follows.
 * The host is not called with values that are not finite.
 */
RARE static int ends_early(Instance *instance, double time, double next) {
    State *now = &instance->now;
    const double before = now->time;
    now->time = time;
    evaluate_outputs(now);
    now->time = before;
    if (find_not_finite(now) < 0) update_intermediately(instance, time, instance->early_return_allowed);
    instance->returned_early = !(next - instance->return_time <= SAME_TIME * (next - time));
    return instance->returned_early;
}

/* The last internal step of a communication step that did not end early. */
static void end_intermediate_updates(Instance *instance) {
    if (instance->intermediate_update != NULL && !instance->returned_early)
        update_intermediately(instance, instance->now.time, 0);
}
