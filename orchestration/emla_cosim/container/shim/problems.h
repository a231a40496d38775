/* What a failed step means for the host. */

static const char *own_type_name(int type) {
    static const char *const names[] = {"Float64", "Float32", "Int8",  "UInt8",  "Int16",   "UInt16", "Int32",
                                        "UInt32",  "Int64",   "UInt64", "Boolean", "Boolean", "String"};
    return names[type];
}

/* Whether a number fits into the type of a call. */
static int fits_type(int type, double value) {
    static const int32_t first = 0;
    double memory;
    const Call call = {.values = &memory, .n_items = 1, .items = &first, .places = &first, .type = type};
    return convert_to(&call, &value);
}

/* Report the number that does not fit into the type of its input. */
static Status blame_range(Instance *instance, int i, const Call *calls, int n) {
    const FmuInstance *stepped = &instance->instances[i];
    instance->memory.phase = FAILED;
    for (int k = 0; k < n; k++)
        for (int item = 0; item < calls[k].n_items; item++) {
            const int j = calls[k].items[item];
            const double value = instance->stepper.input_values[j];
            if (j < stepped->first_input || j >= stepped->first_input + stepped->n_inputs) continue;
            if (!fits_type(calls[k].type, value))
                return report(instance, StatusError,
                              "%s = %.17g does not fit into an input of %s, whose type is %s.",
                              signal_names[instance->stepper.inputs[j].signal], value, parts[i].name,
                              own_type_name(calls[k].type));
        }
    return report(instance, StatusError, "a value does not fit into an input of %s.", parts[i].name);
}

static Status blame_inputs(Instance *instance, int i, int32_t status) {
    const Part *part = &parts[i];
    if (status == OUT_OF_RANGE) return blame_range(instance, i, &instance->calls[part->first_setter], part->n_setters);
    return blame_part(instance, i, "the setting of its inputs", status);
}

static Status blame_step(Instance *instance, int i, int32_t status) {
    Stepper *s = &instance->stepper;
    const StepEnd *end = instance->instances[i].end;
    if (i == N_PARTS) return failed(instance); /* Strings: reported there */
    if (parts[i].events >= 0) return blame_events(instance, i);
    if (status == fmi2Discard) {
        if (wants_end(s, i)) return end_run_of(instance, i, s->time);
        return report(instance, StatusOK, "%s discarded the step from t = %.9g s of %.3g s.", parts[i].name, s->time,
                      s->length);
    }
    if (status == fmi2Error && end != NULL && (end->is_early || end->needs_event)) {
        instance->memory.phase = FAILED;
        if (end->is_early)
            return report(instance, StatusError, "%s returned early at t = %.9g s, which was not allowed.",
                          parts[i].name, end->reached);
        return report(instance, StatusError, "%s asked for event mode, which is not used.", parts[i].name);
    }
    return blame_part(instance, i, "a step", status);
}

/* Return the first signal that a part reads and that is not finite, or -1. */
static int find_not_finite(const Stepper *s) {
    for (int r = 0; r < s->n_read; r++)
        if (!isfinite(s->stores[SIGNALS][s->read[r]])) return s->read[r];
    return -1;
}

/* Report why a step of the system failed. */
static Status blame_failure(Instance *instance) {
    const Stepper *s = &instance->stepper;
    const int i = s->instance, bad = s->failure == NOT_FINITE ? find_not_finite(s) : 0;
    switch (s->failure) {
        case SET_FAILED: return blame_inputs(instance, i, s->status);
        case DERIVATIVES_FAILED: return blame_part(instance, i, "fmi2SetRealInputDerivatives", s->status);
        case STEP_FAILED: return blame_step(instance, i, s->status);
        case GET_FAILED: return blame_part(instance, i, "the reading of its outputs", s->status);
        case SAVE_FAILED: return blame_part(instance, i, "the saving of its state", s->status);
        case RESTORE_FAILED: return blame_part(instance, i, "the restoring of its state", s->status);
        case NO_AGREEMENT:
            return report(instance, StatusError, "the loop of %s does not converge on the step from t = %.9g s of %.3g s.",
                          parts[s->groups[s->group].members[0]].name, s->time, s->length);
        default:
            return report(instance, StatusError, "%s became %g at t = %.9g s.", signal_names[bad],
                          s->stores[SIGNALS][bad], point(s, instance->memory.steps + 1));
    }
}
