/* Strong coupling: strong.py of the master. */

#define NO_AGREEMENT ((Status)100) /* besides the statuses of FMI */

/* Update the largest values with the present signals. */
static void see(Exchange *now) {
    for (int s = 0; s < N_SIGNALS; s++) {
        const double size = fabs(now->signals[s]);
        if (size > now->largest[s] && isfinite(size)) now->largest[s] = size;
    }
}

static Status save_begin(Instance *instance, const Group *group) {
    for (int m = group->first_member; m < group->first_member + group->n_members; m++) {
        const int i = members[m];
        const fmi2Status status = CALL(instance, i, GetFMUstate)(instance->parts[i], &instance->begin[i]);
        if (is_bad(status)) return blame(instance, i, "the saving of its state", status);
    }
    instance->kept = instance->memory.now;
    return StatusOK;
}

static Status restore_parts(Instance *instance, const Group *group) {
    for (int m = group->first_member; m < group->first_member + group->n_members; m++) {
        const int i = members[m];
        const fmi2Status status = CALL(instance, i, SetFMUstate)(instance->parts[i], instance->begin[i]);
        if (is_bad(status)) return blame(instance, i, "the restoring of its state", status);
    }
    return StatusOK;
}

static Status sweep(Instance *instance, const Group *group, double time, double length) {
    for (int m = group->first_member; m < group->first_member + group->n_members; m++) {
        Status status = set_inputs(instance, members[m], time, length);
        if (status == StatusOK) status = step_part(instance, members[m], time, length);
        if (status == StatusOK) status = get_outputs(instance, members[m]);
        if (status != StatusOK) return status;
    }
    return StatusOK;
}

static Status iterate(Instance *instance, const Group *group, double time, double length) {
    Exchange *now = &instance->memory.now;
    const int n = group->n_coupling, *places = &coupling[group->first_coupling];
    double *jacobian = &instance->memory.jacobians[group->jacobian];
    double guess[ROOM(MOST_COUPLING)], sizes[ROOM(MOST_COUPLING)], direction[ROOM(MOST_COUPLING)];
    double earlier[ROOM(MOST_COUPLING * MOST_COUPLING)], basis[ROOM(MOST_COUPLING * MOST_COUPLING)];
    double residuals[ROOM(SWEEPS * MOST_COUPLING)], answers[ROOM(SWEEPS * MOST_COUPLING)];
    for (int c = 0; c < n; c++) guess[c] = predict(now, places[c], time + length);
    for (int m = group->first_member; m < group->first_member + group->n_members; m++)
        shift(now, members[m], time + length);
    if (!group->saved || n == 0) return sweep(instance, group, time, length);
    for (int c = 0; c < n; c++) sizes[c] = now->largest[places[c]] + signals[places[c]].floor;
    memcpy(earlier, jacobian, (size_t)(n * n) * sizeof(double));
    for (int k = 0; k < SWEEPS; k++) {
        Status status = k > 0 ? restore_parts(instance, group) : StatusOK;
        int agreed = 1, finite = 1;
        if (status == StatusOK) {
            for (int c = 0; c < n; c++) now->signals[places[c]] = guess[c];
            status = sweep(instance, group, time, length);
        }
        if (status != StatusOK) return status;
        for (int c = 0; c < n; c++) {
            const double answer = now->signals[places[c]], residual = answer - guess[c];
            answers[k * n + c] = answer;
            residuals[k * n + c] = residual;
            agreed = agreed && fabs(residual) / sizes[c] <= COUPLING_TOLERANCE;
            finite = finite && isfinite(residual);
        }
        if (!finite) break;
        if ((k > 0 && k <= n) || !agreed)
            improve(n, k + 1, residuals, answers, sizes, earlier, jacobian, basis, direction, guess);
        if (agreed) return StatusOK;
    }
    forget(n, jacobian);
    return NO_AGREEMENT;
}

/* Bring a group to the end of the step, in halves if one step fails. */
static Status advance_group(Instance *instance, const Group *group, double time, double length,
                                int halvings) {
    if (group->saved && save_begin(instance, group) != StatusOK) return StatusError;
    const Status status = iterate(instance, group, time, length);
    if (status != StatusDiscard && status != NO_AGREEMENT) return status;
    if (instance->memory.ended) return status;
    if (!group->saved || !group->halves || halvings == 0) {
        if (status == NO_AGREEMENT)
            report(instance, StatusError, "the loop of %s does not converge on the step from t = %.9g s of %.3g s.",
                   parts[members[group->first_member]].name, time, length);
        return status;
    }
    if (restore_parts(instance, group) != StatusOK) return failed(instance);
    instance->memory.now = instance->kept;
    const double middle = time + 0.5 * length, end = time + length;
    const Status first = advance_group(instance, group, time, middle - time, halvings - 1);
    return first != StatusOK ? first : advance_group(instance, group, middle, end - middle, halvings - 1);
}
