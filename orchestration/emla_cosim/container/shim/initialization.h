/* Consistent initial values: initialization.py of the master. */

/* Set the signals that the parts read so that they agree with the start values of the inputs. */
static void assume_inputs(Instance *instance) {
    const Stepper *s = &instance->stepper;
    double *present = s->stores[SIGNALS];
    for (int j = 0; j < N_INPUTS; j++) {
        const Input *input = &s->inputs[j];
        const double assumed = (input_starts[j] - (input->offset + 0.0)) / input->factor;
        if (isfinite(assumed)) present[input->signal] = assumed;
    }
    for (int c = 0; c < N_INITIAL; c++) present[initial_coupling[c]] = initial_guesses[c];
}

static Status settle_members(Instance *instance, const Loop *loop) {
    for (int m = loop->first_member; m < loop->first_member + loop->n_members; m++) {
        Status status = pass_inputs(instance, initial_members[m]);
        if (status == StatusOK) status = read_outputs(instance, initial_members[m]);
        if (status != StatusOK) return status;
    }
    return StatusOK;
}

static Status answer_guess(Instance *instance, const Loop *loop, const double *x, double *found) {
    const int *places = &initial_coupling[loop->first_coupling];
    double *present = instance->stepper.stores[SIGNALS];
    for (int c = 0; c < loop->n_coupling; c++) present[places[c]] = x[c];
    const Status status = settle_members(instance, loop);
    for (int c = 0; c < loop->n_coupling; c++) found[c] = present[places[c]];
    return status;
}

static Status settle_loop(Instance *instance, const Loop *loop) {
    const int *places = &initial_coupling[loop->first_coupling];
    double x[ROOM(MOST_INITIAL)], floors[ROOM(MOST_INITIAL)], *present = instance->stepper.stores[SIGNALS];
    if (loop->n_coupling == 0) return settle_members(instance, loop);
    for (int c = 0; c < loop->n_coupling; c++) {
        x[c] = present[places[c]];
        floors[c] = instance->stepper.signals[places[c]].floor;
    }
    const Status status = solve_loop(instance, loop, answer_guess, floors, x);
    for (int c = 0; c < loop->n_coupling; c++) present[places[c]] = x[c];
    if (status != NO_SOLUTION) return status;
    instance->memory.phase = FAILED;
    return report(instance, StatusError, "the initial values of the loop of %s do not settle.",
                  parts[initial_members[loop->first_member]].name);
}

static Status settle_numbers(Instance *instance) {
    for (int g = 0; g < N_LOOPS; g++)
        if (settle_loop(instance, &loops[g]) != StatusOK) return failed(instance);
    return StatusOK;
}

/* Exchange values in initialization mode until all are consistent, if a value was set since the last time. */
static Status settle(Instance *instance) {
    int changed = 1;
    if (instance->settled) return StatusOK;
    for (int n = 0; n <= N_PARTS + 1 && changed; n++) { /* each text passes all parts at most once */
        if (settle_numbers(instance) != StatusOK) return failed(instance);
        if (pass_texts(instance, &changed) != StatusOK) return failed(instance);
    }
    if (changed) {
        instance->memory.phase = FAILED;
        return report(instance, StatusError, "the initial Strings and Binary values do not settle.");
    }
    instance->settled = 1;
    return StatusOK;
}
