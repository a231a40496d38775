/* Consistent initial values: initialization.py of the master. */

/* Set the signals that the parts read so that they agree with the start values of the inputs. */
static void assume_inputs(Instance *instance) {
    Exchange *now = &instance->memory.now;
    for (int j = 0; j < N_INPUTS; j++) {
        const double assumed = (inputs[j].start - (inputs[j].offset + 0.0)) / inputs[j].factor;
        if (isfinite(assumed)) now->signals[inputs[j].signal] = assumed;
    }
    for (int c = 0; c < N_INITIAL; c++) now->signals[initial_coupling[c]] = initial_guesses[c];
}

static Status settle_members(Instance *instance, const Group *group) {
    for (int m = group->first_member; m < group->first_member + group->n_members; m++) {
        Status status = pass_inputs(instance, initial_members[m]);
        if (status == StatusOK) status = get_outputs(instance, initial_members[m]);
        if (status != StatusOK) return status;
    }
    return StatusOK;
}

static Status answer_guess(Instance *instance, const Group *group, const double *x, double *found) {
    const int *places = &initial_coupling[group->first_coupling];
    double *present = instance->memory.now.signals;
    for (int c = 0; c < group->n_coupling; c++) present[places[c]] = x[c];
    const Status status = settle_members(instance, group);
    for (int c = 0; c < group->n_coupling; c++) found[c] = present[places[c]];
    return status;
}

static Status settle_group(Instance *instance, const Group *group) {
    const int *places = &initial_coupling[group->first_coupling];
    double x[ROOM(MOST_INITIAL)], floors[ROOM(MOST_INITIAL)], *present = instance->memory.now.signals;
    if (group->n_coupling == 0) return settle_members(instance, group);
    for (int c = 0; c < group->n_coupling; c++) {
        x[c] = present[places[c]];
        floors[c] = signals[places[c]].floor;
    }
    const Status status = solve_loop(instance, group, answer_guess, floors, x);
    for (int c = 0; c < group->n_coupling; c++) present[places[c]] = x[c];
    if (status != NO_AGREEMENT) return status;
    instance->memory.phase = FAILED;
    return report(instance, StatusError, "the initial values of the loop of %s do not settle.",
                  parts[initial_members[group->first_member]].name);
}

/* Exchange values in initialization mode until all are consistent, if a value was set since the last time. */
static Status settle(Instance *instance) {
    if (instance->settled) return StatusOK;
    for (int g = 0; g < N_INITIAL_GROUPS; g++)
        if (settle_group(instance, &initial_groups[g]) != StatusOK) return failed(instance);
    instance->settled = 1;
    return StatusOK;
}
