/* Groups of instances that repeat a step until the values that they exchange agree. */

/* Update the largest values with the present signals. */
static void see(Stepper *s) {
    const double *now = s->stores[SIGNALS];
    for (int32_t k = 0; k < s->n_signals; k++) {
        const double size = fabs(now[k]);
        if (size > s->largest[k] && isfinite(size)) s->largest[k] = size;
    }
}

/* Note that an instance does a step of this length, as a part of one that it has discarded. */
static void note_division(const Stepper *s, int32_t i, double length, int is_first) {
    if (s->divisions == NULL) return;
    s->divisions[i].steps += is_first;
    s->divisions[i].shortest = fmin(s->divisions[i].shortest, length);
}

/* Save what the step of a group changes: states, signals and their history. */
static int32_t save_group(Stepper *s, const Group *group) {
    const double *now = s->stores[SIGNALS], *previous = s->stores[PREVIOUS];
    double *kept = group->kept;
    for (int32_t m = 0; m < group->n_members; m++) {
        const int32_t i = group->members[m];
        const FmuInstance *instance = &s->instances[i];
        const size_t size = (size_t)instance->n_outputs * sizeof(double);
        const int32_t failure = save_state(s, i, instance->state);
        if (failure != DONE) return failure;
        if (size > 0) {
            memcpy(kept, now + instance->first_output, size);
            memcpy(kept + instance->n_outputs, previous + instance->first_output, size);
        }
        kept += 2 * instance->n_outputs;
        *kept++ = s->at[i];
        *kept++ = s->before[i];
    }
    return DONE;
}

static int32_t restore_states(Stepper *s, const Group *group) {
    for (int32_t m = 0; m < group->n_members; m++) {
        const int32_t i = group->members[m], failure = restore_state(s, i, s->instances[i].state);
        if (failure != DONE) return failure;
    }
    return DONE;
}

static int32_t restore_group(Stepper *s, const Group *group) {
    double *now = s->stores[SIGNALS], *previous = s->stores[PREVIOUS];
    const double *kept = group->kept;
    for (int32_t m = 0; m < group->n_members; m++) {
        const int32_t i = group->members[m];
        const FmuInstance *instance = &s->instances[i];
        const size_t size = (size_t)instance->n_outputs * sizeof(double);
        if (size > 0) {
            memcpy(now + instance->first_output, kept, size);
            memcpy(previous + instance->first_output, kept + instance->n_outputs, size);
        }
        kept += 2 * instance->n_outputs;
        s->at[i] = *kept++;
        s->before[i] = *kept++;
    }
    return restore_states(s, group);
}

/* Do one operation of a sweep. */
static int32_t operate_again(Stepper *s, const Operation *operation, double time, double length) {
    switch (operation->call) {
        case SET_INPUTS: return set_inputs(s, operation->target, SIGNALS, time, length);
        case DO_STEP: return do_step(s, operation->target, time, length);
        case END_STEP: return end_step(s, operation->target, time, length);
        default: return get_outputs(s, operation->target);
    }
}

/* Do the step of every member with the newest values. */
static int32_t sweep(Stepper *s, const Group *group, double time, double length) {
    for (int32_t o = 0; o < group->n_operations; o++) {
        const int32_t failure = operate_again(s, &group->operations[o], time, length);
        if (failure != DONE) return failure;
    }
    return DONE;
}

/* Store answers and residuals of a sweep; returns whether all agree, and in `finite` whether they are. */
static int compare(const Stepper *s, const Group *group, int32_t k, int *finite) {
    const double *now = s->stores[SIGNALS];
    const int32_t n = group->n_coupling;
    int agreed = 1;
    *finite = 1;
    for (int32_t c = 0; c < n; c++) {
        const double answer = now[group->coupling[c]], residual = answer - group->guess[c];
        group->answers[k * n + c] = answer;
        group->residuals[k * n + c] = residual;
        agreed = agreed && fabs(residual) / group->sizes[c] <= s->coupling_tolerance;
        *finite = *finite && isfinite(residual);
    }
    return agreed;
}

static int32_t iterate(Stepper *s, const Group *group, double time, double length) {
    double *now = s->stores[SIGNALS];
    const int32_t n = group->n_coupling;
    for (int32_t c = 0; c < n; c++) group->guess[c] = predict(s, group->coupling[c], time + length);
    for (int32_t m = 0; m < group->n_members; m++) shift(s, group->members[m], time + length);
    if (!group->is_saved || n == 0) return sweep(s, group, time, length);
    for (int32_t c = 0; c < n; c++) {
        const int32_t signal = group->coupling[c];
        group->sizes[c] = s->largest[signal] + s->signals[signal].floor;
    }
    memcpy(group->earlier, group->jacobian, (size_t)n * (size_t)n * sizeof(double));
    s->group_sweeps = 0;
    for (int32_t k = 0; k < s->sweeps; k++) {
        int32_t failure = k > 0 ? restore_states(s, group) : DONE;
        int finite = 1;
        if (failure == DONE) {
            for (int32_t c = 0; c < n; c++) now[group->coupling[c]] = group->guess[c];
            failure = sweep(s, group, time, length);
        }
        if (failure != DONE) return failure;
        s->sweeps_done++;
        s->group_sweeps = k + 1;
        const int agreed = compare(s, group, k, &finite);
        if (!finite) break;
        /* n differences are enough; the last, small one adds least */
        if ((k > 0 && k <= n) || !agreed)
            improve(n, k + 1, group->residuals, group->answers, group->sizes, group->earlier, group->jacobian,
                    group->basis, group->direction, group->guess);
        if (agreed) return DONE;
    }
    forget(n, group->jacobian);
    s->time = time;
    s->length = length;
    return NO_AGREEMENT;
}

/* Bring a group to the end of the step, in halves if one step fails. */
static int32_t solve(Stepper *s, int32_t g, double time, double length, int32_t halvings) {
    const Group *group = &s->groups[g];
    int32_t failure = group->is_saved ? save_group(s, group) : DONE;
    if (failure != DONE) return failure;
    failure = iterate(s, group, time, length);
    if (failure == DONE) return DONE;
    s->group = g;
    const int is_discarded = failure == STEP_FAILED && s->status == fmi2Discard;
    if (failure != NO_AGREEMENT && !is_discarded) return failure;
    if (!group->is_saved || !group->is_halved || halvings == 0) return failure;
    if (is_discarded && wants_end(s, s->instance)) return failure;
    const int32_t restored = restore_group(s, group);
    if (restored != DONE) return restored;
    s->status = fmi2OK;
    const double middle = time + 0.5 * length, end = time + length;
    if (is_discarded) note_division(s, s->instance, middle - time, halvings == s->halvings);
    failure = solve(s, g, time, middle - time, halvings - 1);
    return failure != DONE ? failure : solve(s, g, middle, end - middle, halvings - 1);
}
