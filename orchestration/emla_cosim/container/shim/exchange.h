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

/* Set the inputs of one type; TYPES are called one after the other, as the master does. */
static fmi2Status set_typed(Instance *instance, int i, char type) {
    const Part *part = &parts[i];
    fmi2ValueReference references[ROOM(MOST_INPUTS)];
    double reals[ROOM(MOST_INPUTS)];
    int whole[ROOM(MOST_INPUTS)];
    size_t n = 0;
    for (int j = part->first_input; j < part->first_input + part->n_inputs; j++) {
        if (inputs[j].type != type) continue;
        const double value = type == 'R' ? instance->inputs[j] : rint(instance->inputs[j]);
        references[n] = inputs[j].reference;
        reals[n] = value;
        whole[n] = type == 'B' ? value != 0.0 : (int)fmax(INT_MIN, fmin(value, INT_MAX));
        n++;
    }
    if (n == 0) return fmi2OK;
    const fmi2Component c = instance->parts[i];
    if (type == 'R') return CALL(instance, i, SetReal)(c, references, n, reals);
    if (type == 'I') return CALL(instance, i, SetInteger)(c, references, n, whole);
    return CALL(instance, i, SetBoolean)(c, references, n, whole);
}

static fmi2Status get_typed(Instance *instance, int i, char type) {
    const Part *part = &parts[i];
    fmi2ValueReference references[ROOM(MOST_OUTPUTS)];
    double reals[ROOM(MOST_OUTPUTS)];
    int whole[ROOM(MOST_OUTPUTS)], places[ROOM(MOST_OUTPUTS)];
    size_t n = 0;
    for (int s = part->first_output; s < part->first_output + part->n_outputs; s++) {
        if (signals[s].type != type) continue;
        references[n] = signals[s].reference;
        places[n++] = s;
    }
    if (n == 0) return fmi2OK;
    const fmi2Component c = instance->parts[i];
    const fmi2Status status = type == 'R'   ? CALL(instance, i, GetReal)(c, references, n, reals)
                              : type == 'I' ? CALL(instance, i, GetInteger)(c, references, n, whole)
                                            : CALL(instance, i, GetBoolean)(c, references, n, whole);
    if (is_bad(status)) return status;
    for (size_t k = 0; k < n; k++)
        instance->memory.now.signals[places[k]] =
            type == 'R' ? reals[k] : type == 'I' ? (double)whole[k] : (double)(whole[k] != 0);
    return status;
}

static const char TYPES[] = "RIB";

/* Set the inputs of a part for the step from `time` of this length. */
static Status set_inputs(Instance *instance, int i, double time, double length) {
    const Part *part = &parts[i];
    const fmi2Component c = instance->parts[i];
    if (part->n_inputs == 0) return StatusOK;
    compute_inputs(instance, i, time, length);
    fmi2Status status = fmi2OK;
    if (part->typed)
        for (const char *type = TYPES; *type && !is_bad(status); type++) status = set_typed(instance, i, *type);
    else
        status = CALL(instance, i, SetReal)(c, &input_references[part->first_input], (size_t)part->n_inputs,
                                            &instance->inputs[part->first_input]);
    if (is_bad(status)) return blame(instance, i, "the setting of its inputs", status);
    if (part->mode != LINE) return StatusOK;
    static const fmi2Integer orders[ROOM(MOST_INPUTS)] = FIRST_ORDERS;
    status = CALL(instance, i, SetRealInputDerivatives)(c, &input_references[part->first_input],
                                                        (size_t)part->n_inputs, orders,
                                                        &instance->derivatives[part->first_input]);
    return is_bad(status) ? blame(instance, i, "fmi2SetRealInputDerivatives", status) : StatusOK;
}

/* Set the inputs of a part to the present signals. */
static Status pass_inputs(Instance *instance, int i) {
    const Part *part = &parts[i];
    if (part->n_inputs == 0) return StatusOK;
    for (int j = part->first_input; j < part->first_input + part->n_inputs; j++)
        instance->inputs[j] =
            inputs[j].factor * instance->memory.now.signals[inputs[j].signal] + inputs[j].offset;
    fmi2Status status = fmi2OK;
    for (const char *type = TYPES; *type && !is_bad(status); type++) status = set_typed(instance, i, *type);
    return is_bad(status) ? blame(instance, i, "the setting of its inputs", status) : StatusOK;
}

/* Read the signals of a part. */
static Status get_outputs(Instance *instance, int i) {
    const Part *part = &parts[i];
    if (part->n_outputs == 0) return StatusOK;
    fmi2Status status = fmi2OK;
    if (part->typed)
        for (const char *type = TYPES; *type && !is_bad(status); type++) status = get_typed(instance, i, *type);
    else
        status = CALL(instance, i, GetReal)(instance->parts[i], &output_references[part->first_output],
                                            (size_t)part->n_outputs,
                                            &instance->memory.now.signals[part->first_output]);
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
    const fmi2Boolean no_way_back = parts[i].saved ? fmi2False : fmi2True;
    const fmi2Component c = instance->parts[i];
    const fmi2Status status = CALL(instance, i, DoStep)(c, time, length, no_way_back);
    if (!is_bad(status)) return StatusOK;
    if (status == fmi2Discard) {
        fmi2Boolean asks = fmi2False;
        if (CALL(instance, i, GetBooleanStatus)(c, fmi2Terminated, &asks) == fmi2OK && asks != fmi2False) {
            instance->memory.ended = 1;
            report(instance, StatusDiscard, "%s asks to end the simulation at t = %.9g s.", parts[i].name, time);
        } else {
            report(instance, StatusOK, "%s discarded the step from t = %.9g s of %.3g s.", parts[i].name, time,
                   length);
        }
        return StatusDiscard;
    }
    return blame(instance, i, "fmi2DoStep", status);
}

static int find_not_finite(const Exchange *now) {
    for (int r = 0; r < N_READ; r++)
        if (!isfinite(now->signals[read_signals[r]])) return read_signals[r];
    return -1;
}
