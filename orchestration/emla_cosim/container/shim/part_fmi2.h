/* Calls of parts of FMI 2.0. */

static void *allocate(size_t n, size_t size) { return calloc(n, size); }

/* Pass on a message of a part. */
static void pass_on(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                    fmi2String category, fmi2String format, ...) {
    char text[2 * MESSAGE_LENGTH];
    va_list arguments;
    (void)name, (void)category;
    if (format == NULL || !hears(environment, (Status)status)) return;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    relay(environment, (Status)status, text);
}

static fmi2Component instantiate_2(Instance *instance, int i, const char *location) {
    fmi2CallbackFunctions *callbacks = &instance->callbacks[i];
    callbacks->logger = pass_on;
    callbacks->allocateMemory = allocate;
    callbacks->freeMemory = free;
    callbacks->stepFinished = NULL;
    callbacks->componentEnvironment = &instance->senders[i];
    return CALL(instance, i, Instantiate)(parts[i].name, fmi2CoSimulation, libraries[parts[i].library].guid, location,
                                          callbacks, fmi2False, fmi2True);
}

static fmi2Status set_up_2(Instance *instance, int i, const Experiment *experiment) {
    const int stops = isfinite(experiment->stop);
    return CALL(instance, i, SetupExperiment)(
        instance->parts[i], experiment->tolerance > 0.0 ? fmi2True : fmi2False, experiment->tolerance,
        experiment->start, stops ? fmi2True : fmi2False, stops ? experiment->stop : 0.0);
}

static fmi2Status enter_2(Instance *instance, int i, const Experiment *experiment) {
    (void)experiment;
    return CALL(instance, i, EnterInitializationMode)(instance->parts[i]);
}

static fmi2Status set_2(Instance *instance, int i, char type, const fmi2ValueReference *references, size_t n,
                        const double *values, size_t count) {
    const fmi2Component c = instance->parts[i];
    int *whole = (void *)instance->converted;
    if (type == 'R') return CALL(instance, i, SetReal)(c, references, n, values);
    for (size_t k = 0; k < count; k++)
        whole[k] = type == 'B' ? values[k] != 0.0 : (int)fmax(INT_MIN, fmin(values[k], INT_MAX));
    return type == 'B' ? CALL(instance, i, SetBoolean)(c, references, n, whole)
                       : CALL(instance, i, SetInteger)(c, references, n, whole);
}

static fmi2Status get_2(Instance *instance, int i, char type, const fmi2ValueReference *references, size_t n,
                        double *values, size_t count) {
    const fmi2Component c = instance->parts[i];
    int *whole = (void *)instance->converted;
    if (type == 'R') return CALL(instance, i, GetReal)(c, references, n, values);
    memset(whole, 0, count * sizeof *whole);
    const fmi2Status status = type == 'B' ? CALL(instance, i, GetBoolean)(c, references, n, whole)
                                          : CALL(instance, i, GetInteger)(c, references, n, whole);
    for (size_t k = 0; k < count && !is_bad(status); k++)
        values[k] = type == 'B' ? (double)(whole[k] != fmi2False) : (double)whole[k];
    return status;
}

static fmi2Status set_text_2(Instance *instance, int i, fmi2ValueReference reference, const char *text) {
    return CALL(instance, i, SetString)(instance->parts[i], &reference, 1, &text);
}

static fmi2Status get_text_2(Instance *instance, int i, fmi2ValueReference reference, const char **text) {
    return CALL(instance, i, GetString)(instance->parts[i], &reference, 1, text);
}

static fmi2Status step_2(Instance *instance, int i, double time, double length, int no_way_back, int *ends) {
    const fmi2Component c = instance->parts[i];
    const fmi2Status status =
        CALL(instance, i, DoStep)(c, time, length, no_way_back ? fmi2True : fmi2False);
    fmi2Boolean asks = fmi2False;
    if (status == fmi2Discard && CALL(instance, i, GetBooleanStatus)(c, fmi2Terminated, &asks) == fmi2OK)
        *ends = asks != fmi2False;
    return status;
}

static const Version version_2 = {"fmi2", instantiate_2, set_up_2,   enter_2,    set_2,
                                  get_2,  set_text_2,    get_text_2, step_2};
