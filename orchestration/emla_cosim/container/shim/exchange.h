/* The exchange of values: extrapolation.py and compiled_calls.py of the master. */

/* Return the signal extrapolated to `time`. */
static double predict(const Exchange *now, int signal, double time) {
    const int owner = signals[signal].part;
    const double newest = now->at[owner], span = newest - now->before[owner];
    double slope = 0.0;
    if (signals[signal].smooth && span > 0.0) slope = (now->signals[signal] - now->previous[signal]) / span;
    return now->signals[signal] + (time - newest) * slope;
}

static void compute_inputs(Instance *instance, int i, double time, double length) {
    Exchange *now = &instance->memory.now;
    const Part *part = &parts[i];
    const double middle = part->mode == MIDDLE ? 0.5 * length : 0.0;
    for (int j = part->first_input; j < part->first_input + part->n_inputs; j++) {
        const Input *input = &inputs[j];
        const double signal = now->signals[input->signal];
        if (part->mode == HOLD) {
            instance->inputs[j] = input->factor * signal + input->offset;
            continue;
        }
        const int owner = signals[input->signal].part;
        const double newest = now->at[owner];
        double earlier = now->previous[input->signal], then = now->before[owner];
        if (part->rare) {
            if (now->taken_at[j] < then) {
                earlier = now->taken[j];
                then = now->taken_at[j];
            }
            now->taken[j] = signal;
            now->taken_at[j] = newest;
        }
        const double span = newest - then;
        const double slope = input->moves && span > 0.0 ? (signal - earlier) / span : 0.0;
        instance->inputs[j] = input->factor * (signal + (time - newest + middle) * slope) + input->offset;
        instance->derivatives[j] = input->factor * slope;
    }
}

/* Set the inputs of one call. */
static fmi2Status set_typed(Instance *instance, int i, const Call *call) {
    const int whole = call->type != 'R' && call->type != 'r';
    double *values = call->elements < 0 ? instance->numbers : &instance->memory.elements[call->elements];
    for (int k = call->first_item; k < call->first_item + call->n_items; k++) {
        const int j = call_items[k];
        const double value = whole ? rint(instance->inputs[j]) : instance->inputs[j];
        if (libraries[parts[i].library].fmi == 3 && !fits(call->type, value)) {
            report(instance, StatusError, "%s = %.17g does not fit into an input of %s, whose type is %s.",
                   signals[inputs[j].signal].name, value, parts[i].name, type_name(call->type));
            return fmi2Error;
        }
        values[call_places[k]] = value;
    }
    return version_of(i)->set(instance, i, call->type, &call_references[call->first_reference],
                              (size_t)call->n_references, values, (size_t)call->n_values);
}

static fmi2Status get_typed(Instance *instance, int i, const Call *call) {
    const fmi2Status status =
        version_of(i)->get(instance, i, call->type, &call_references[call->first_reference],
                           (size_t)call->n_references, instance->numbers, (size_t)call->n_values);
    for (int k = call->first_item; k < call->first_item + call->n_items && !is_bad(status); k++)
        instance->memory.now.signals[call_items[k]] = instance->numbers[call_places[k]];
    return status;
}

static fmi2Status set_all_types(Instance *instance, int i) {
    fmi2Status status = fmi2OK;
    for (int k = parts[i].first_set; k < parts[i].first_set + parts[i].n_sets && !is_bad(status); k++)
        status = set_typed(instance, i, &calls[k]);
    return status;
}

static fmi2Status get_all_types(Instance *instance, int i) {
    fmi2Status status = fmi2OK;
    for (int k = parts[i].first_get; k < parts[i].first_get + parts[i].n_gets && !is_bad(status); k++)
        status = get_typed(instance, i, &calls[k]);
    return status;
}

/* Set the inputs of a part for the step from `time` of this length. */
static Status set_inputs(Instance *instance, int i, double time, double length) {
    const Part *part = &parts[i];
    const size_t n = (size_t)part->n_inputs;
    if (n == 0) return StatusOK;
    compute_inputs(instance, i, time, length);
    fmi2Status status = part->typed
                            ? set_all_types(instance, i)
                            : version_of(i)->set(instance, i, 'R', &input_references[part->first_input], n,
                                                 &instance->inputs[part->first_input], n);
    if (is_bad(status)) return blame(instance, i, "the setting of its inputs", status);
    if (part->mode != LINE) return StatusOK;
    static const fmi2Integer orders[ROOM(MOST_INPUTS)] = FIRST_ORDERS;
    status = CALL(instance, i, SetRealInputDerivatives)(instance->parts[i], &input_references[part->first_input], n,
                                                        orders, &instance->derivatives[part->first_input]);
    return is_bad(status) ? blame(instance, i, "fmi2SetRealInputDerivatives", status) : StatusOK;
}

/* Set the inputs of a part to the present signals. */
static Status pass_inputs(Instance *instance, int i) {
    const Part *part = &parts[i];
    if (part->n_inputs == 0) return StatusOK;
    for (int j = part->first_input; j < part->first_input + part->n_inputs; j++)
        instance->inputs[j] =
            inputs[j].factor * instance->memory.now.signals[inputs[j].signal] + inputs[j].offset;
    const fmi2Status status = set_all_types(instance, i);
    return is_bad(status) ? blame(instance, i, "the setting of its inputs", status) : StatusOK;
}

/* Read the signals of a part. */
static Status get_outputs(Instance *instance, int i) {
    const Part *part = &parts[i];
    if (part->n_outputs == 0) return StatusOK;
    const size_t n = (size_t)part->n_outputs;
    const fmi2Status status =
        part->typed ? get_all_types(instance, i)
                    : version_of(i)->get(instance, i, 'R', &output_references[part->first_output], n,
                                         &instance->memory.now.signals[part->first_output], n);
    return is_bad(status) ? blame(instance, i, "the reading of its outputs", status) : StatusOK;
}

/* Move the signals of a part to the history, before those of `time`. */
static void shift(Exchange *now, int i, double time) {
    const Part *part = &parts[i];
    memcpy(now->previous + part->first_output, now->signals + part->first_output,
           (size_t)part->n_outputs * sizeof(double));
    now->before[i] = now->at[i];
    now->at[i] = time;
}

/* Do the step of a part. StatusDiscard is passed on: a shorter step may succeed. */
static Status step_part(Instance *instance, int i, double time, double length) {
    int ends = 0;
    const int no_way_back = !parts[i].saved && !instance->goes_back;
    const fmi2Status status = version_of(i)->step(instance, i, time, length, no_way_back, &ends);
    if (!is_bad(status)) return StatusOK;
    if (status != fmi2Discard) return blame(instance, i, "a step", status);
    if (ends) {
        instance->memory.ended = 1;
        report(instance, StatusDiscard, "%s asks to end the simulation at t = %.9g s.", parts[i].name, time);
    } else {
        report(instance, StatusOK, "%s discarded the step from t = %.9g s of %.3g s.", parts[i].name, time, length);
    }
    return StatusDiscard;
}

static int find_not_finite(const Exchange *now) {
    for (int r = 0; r < N_READ; r++)
        if (!isfinite(now->signals[read_signals[r]])) return read_signals[r];
    return -1;
}
