/* The exchange of values; extrapolation.py has the equations. */

/* Return the signal extrapolated to `time`. */
static double predict(const Stepper *s, int32_t signal, double time) {
    const double *now = s->stores[SIGNALS], *earlier = s->stores[PREVIOUS];
    const int32_t owner = s->signals[signal].instance;
    const double newest = s->at[owner], span = newest - s->before[owner];
    double slope = 0.0;
    if (s->signals[signal].is_smooth && span > 0.0) slope = (now[signal] - earlier[signal]) / span;
    return now[signal] + (time - newest) * slope;
}

ALWAYS_INLINE static void hold_inputs(Stepper *s, const FmuInstance *instance, const double *values) {
    const Input *restrict inputs = s->inputs + instance->first_input;
    double *restrict results = s->input_values + instance->first_input;
    for (int32_t j = 0; j < instance->n_inputs; j++)
        results[j] = inputs[j].factor * values[inputs[j].signal] + inputs[j].offset;
}

/* Return a known signal in the step from `time` of this length, and its slope. A step that is a part of that of the
   source gets a part of its line. */
static double read_known(const Stepper *s, const Input *input, double time, double length, double *slope) {
    const int32_t signal = input->signal, owner = s->signals[signal].instance;
    const double then = s->before[owner], span = s->at[owner] - then;
    *slope = 0.0;
    if (input->known == KNOWN_SAMPLE || !(span > 0.0)) return s->stores[SIGNALS][signal];
    if (input->known == KNOWN_BEGIN) return s->stores[PREVIOUS][signal];
    const double begin = s->stores[s->first_span + SPAN_BEGIN][signal];
    const double rate = (s->stores[s->first_span + SPAN_END][signal] - begin) / span;
    if (input->known == KNOWN_MEAN) {
        const int is_part = length < 0.75 * span;
        return is_part ? begin + (time - then + 0.5 * length) * rate : s->stores[s->first_span + SPAN_MEAN][signal];
    }
    *slope = rate;
    return begin + (time - then) * rate;
}

NOINLINE static void extrapolate_inputs(Stepper *s, const FmuInstance *instance, double time, double length) {
    const double *now = s->stores[SIGNALS], *previous = s->stores[PREVIOUS];
    const double middle = instance->mode == MIDDLE ? 0.5 * length : 0.0;
    const int32_t last = instance->first_input + instance->n_inputs;
    for (int32_t j = instance->first_input; j < last; j++) {
        const Input *input = &s->inputs[j];
        const double signal = now[input->signal];
        if (input->known != NOT_KNOWN || instance->mode == HOLD) {
            double slope = 0.0;
            const double value = input->known != NOT_KNOWN ? read_known(s, input, time, length, &slope) : signal;
            s->input_values[j] = input->factor * value + input->offset;
            s->derivatives[j] = input->factor * slope;
            continue;
        }
        const int32_t owner = s->signals[input->signal].instance;
        const double newest = s->at[owner];
        double earlier = previous[input->signal], then = s->before[owner];
        if (instance->is_rare) {
            if (s->taken_at[j] < then) {
                earlier = s->taken[j];
                then = s->taken_at[j];
            }
            s->taken[j] = signal;
            s->taken_at[j] = newest;
        }
        const double span = newest - then;
        const double slope = input->moves && span > 0.0 ? (signal - earlier) / span : 0.0;
        s->input_values[j] = input->factor * (signal + (time - newest + middle) * slope) + input->offset;
        s->derivatives[j] = input->factor * slope;
    }
}

/* Pass the values of its inputs on to an instance, with their derivatives if they are not held. */
ALWAYS_INLINE static int32_t send_inputs(Stepper *s, int32_t i, int is_held) {
    const FmuInstance *instance = &s->instances[i];
    const int64_t start = start_clock(instance->effort);
    const int32_t status = set_values(s, instance->setters, instance->n_setters, s->input_values);
    stop_clock(instance->effort, INPUT_CALLS, start);
    if (is_bad(status)) return fail(s, SET_FAILED, i, status);
    if (!instance->has_slopes || is_held) return DONE;
    announce(s, instance->code + instance->code_derivatives);
    const int64_t began = start_clock(instance->effort);
    const int32_t answer = (int32_t)((fmi2SetRealInputDerivativesTYPE *)instance->set_derivatives)(
        instance->component, instance->references, (size_t)instance->n_inputs, instance->orders,
        &s->derivatives[instance->first_input]);
    stop_clock(instance->effort, INPUT_CALLS, began);
    return is_bad(answer) ? fail(s, DERIVATIVES_FAILED, i, answer) : DONE;
}

/* Set the inputs of an instance for the step from `time` of this length. Those from another vector than the
   signals are held. */
ALWAYS_INLINE static int32_t set_inputs(Stepper *s, int32_t i, int32_t store, double time, double length) {
    const FmuInstance *instance = &s->instances[i];
    if (instance->n_inputs == 0) return DONE;
    const int is_held = instance->is_held || store != SIGNALS;
    if (is_held)
        hold_inputs(s, instance, s->stores[store]);
    else
        extrapolate_inputs(s, instance, time, length);
    return send_inputs(s, i, is_held);
}

ALWAYS_INLINE static int32_t get_signals(Stepper *s, int32_t i) {
    const FmuInstance *instance = &s->instances[i];
    const int64_t start = start_clock(instance->effort);
    const int32_t status = get_values(s, instance->getters, instance->n_getters, s->stores[SIGNALS]);
    stop_clock(instance->effort, OUTPUT_CALLS, start);
    return is_bad(status) ? fail(s, GET_FAILED, i, status) : DONE;
}

/* Get outputs that depend directly on a known input. The states took its mean over the step; outputs at the end of the
   step belong to its value there. */
NOINLINE static int32_t follow(Stepper *s, int32_t i) {
    const FmuInstance *instance = &s->instances[i];
    const int32_t last = instance->first_input + instance->n_inputs;
    for (int32_t j = instance->first_input; j < last; j++) {
        const Input *input = &s->inputs[j];
        if (input->known == KNOWN_MEAN)
            s->input_values[j] = input->factor * s->stores[SIGNALS][input->signal] + input->offset;
    }
    const int64_t start = start_clock(instance->effort);
    const int32_t status = set_values(s, instance->setters, instance->n_setters, s->input_values);
    stop_clock(instance->effort, INPUT_CALLS, start);
    return is_bad(status) ? fail(s, SET_FAILED, i, status) : get_signals(s, i);
}

ALWAYS_INLINE static int32_t get_outputs(Stepper *s, int32_t i) {
    const FmuInstance *instance = &s->instances[i];
    if (instance->n_outputs == 0) return DONE;
    return s->follows[i] ? follow(s, i) : get_signals(s, i);
}

/* Move the signals of an instance to the history, before those of `time`. */
ALWAYS_INLINE static void shift(Stepper *s, int32_t i, double time) {
    const FmuInstance *instance = &s->instances[i];
    const double *restrict now = s->stores[SIGNALS] + instance->first_output;
    double *restrict previous = s->stores[PREVIOUS] + instance->first_output;
    for (int32_t k = 0; k < instance->n_outputs; k++) previous[k] = now[k];
    s->before[i] = s->at[i];
    s->at[i] = time;
}

NOINLINE static void combine(Stepper *s, const Combination *combination) {
    const FmuInstance *instance = &s->instances[combination->instance];
    const Term *terms = &s->terms[combination->first_term];
    double *into = s->stores[combination->into];
    const int32_t last = instance->first_output + instance->n_outputs;
    for (int32_t k = instance->first_output; k < last; k++) {
        double sum = terms[0].factor * s->stores[terms[0].store][k];
        for (int32_t t = 1; t < combination->n_terms; t++) sum += terms[t].factor * s->stores[terms[t].store][k];
        into[k] = sum;
    }
}

#define EXPONENT 0x7FF /* all its bits are set if a double is not finite */

/* Whether all signals that instances read are finite. A test of all signals comes first: it has no branches, so
   that the processor tests several at once. */
static int are_finite(const Stepper *s) {
    const double *now = s->stores[SIGNALS];
    uint64_t largest = 0;
    for (int32_t k = 0; k < s->n_signals; k++) {
        uint64_t bits;
        memcpy(&bits, &now[k], sizeof bits);
        largest |= ((bits >> 52) & EXPONENT) + 1; /* above the exponent if all its bits are set */
    }
    if (largest <= EXPONENT) return 1;
    for (int32_t r = 0; r < s->n_read; r++)
        if (!isfinite(now[s->read[r]])) return 0;
    return 1;
}
