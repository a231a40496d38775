/* Steps of one instance in halves, if it discards the whole step.
 *
 * Its inputs are those of the whole step: held, or on their lines. Nothing else is done in between, so that other
 * instances do not notice, in whatever order the program calls them.
 */

static int is_discarded(const Stepper *s, int32_t failure) { return failure == STEP_FAILED && s->status == fmi2Discard; }

/* Move inputs on their lines. */
static void advance_inputs(Stepper *s, const FmuInstance *instance, double length) {
    const int32_t last = instance->first_input + instance->n_inputs;
    for (int32_t j = instance->first_input; j < last && instance->has_slopes; j++)
        s->input_values[j] += length * s->derivatives[j];
}

static int32_t do_part(Stepper *s, int32_t i, double time, double length, int32_t halvings);

/* Do the halves of a step that an instance has discarded. Its state at `time` is saved. */
static int32_t do_halves(Stepper *s, int32_t i, double time, double length, int32_t halvings) {
    const FmuInstance *instance = &s->instances[i];
    const double middle = time + 0.5 * length;
    if (halvings == 0 || wants_end(s, i)) return STEP_FAILED;
    note_division(s, i, middle - time, halvings == s->halvings);
    int32_t failure = restore_state(s, i, instance->state);
    if (failure == DONE) failure = do_part(s, i, time, middle - time, halvings - 1);
    if (failure == DONE) failure = do_part(s, i, middle, time + length - middle, halvings - 1);
    return failure;
}

/* Do a part of a step, and move the inputs to its end. */
static int32_t do_part(Stepper *s, int32_t i, double time, double length, int32_t halvings) {
    const FmuInstance *instance = &s->instances[i];
    s->status = fmi2OK;
    int32_t failure = instance->n_inputs > 0 ? send_inputs(s, i, 0) : DONE;
    if (failure == DONE) failure = save_state(s, i, instance->state);
    if (failure == DONE) failure = do_step(s, i, time, length);
    if (failure == DONE && instance->end_step != NULL) failure = end_step(s, i, time, length);
    if (is_discarded(s, failure)) return do_halves(s, i, time, length, halvings);
    if (failure != DONE) return failure;
    advance_inputs(s, instance, length);
    return DONE;
}

/* Do the rest of a step that an instance may have discarded. */
static int32_t repeat_discarded(Stepper *s, int32_t i, double time, double length, int32_t failure) {
    return is_discarded(s, failure) ? do_halves(s, i, time, length, s->halvings) : failure;
}

NOINLINE static int32_t end_divided_step(Stepper *s, int32_t i, double time, double length) {
    return repeat_discarded(s, i, time, length, end_step(s, i, time, length));
}

/* Do a step, in halves if it is discarded; one in another process only begins. */
NOINLINE static int32_t divide_step(Stepper *s, int32_t i, double time, double length) {
    int32_t failure = save_state(s, i, s->instances[i].state);
    if (failure == DONE) failure = do_step(s, i, time, length);
    return s->instances[i].end_step != NULL ? failure : repeat_discarded(s, i, time, length, failure);
}
