/* Values of single variables of the parts, and the exchange of all of them outside of steps. */

/* Return the function that gets or sets values of a type. */
static Function value_function(const Instance *instance, int part, int type, int sets) {
    static const int at_2[][2] = {[TYPE_FLOAT64] = {FMI2_GetReal, FMI2_SetReal},
                                  [TYPE_INT32] = {FMI2_GetInteger, FMI2_SetInteger},
                                  [TYPE_BOOLEAN_2] = {FMI2_GetBoolean, FMI2_SetBoolean},
                                  [TYPE_TEXT] = {FMI2_GetString, FMI2_SetString}};
    const Function *functions = instance->functions[parts[part].library];
#ifdef HAS_FMI3_PARTS
#define BOTH(Name) {FMI3_Get##Name, FMI3_Set##Name}
    static const int at_3[][2] = {
        [TYPE_FLOAT64] = BOTH(Float64), [TYPE_FLOAT32] = BOTH(Float32), [TYPE_INT8] = BOTH(Int8),
        [TYPE_UINT8] = BOTH(UInt8),     [TYPE_INT16] = BOTH(Int16),     [TYPE_UINT16] = BOTH(UInt16),
        [TYPE_INT32] = BOTH(Int32),     [TYPE_UINT32] = BOTH(UInt32),   [TYPE_INT64] = BOTH(Int64),
        [TYPE_UINT64] = BOTH(UInt64),   [TYPE_BOOLEAN] = BOTH(Boolean), [TYPE_TEXT] = BOTH(String)};
#undef BOTH
    if (is_version_3(part)) return functions[at_3[type][sets]];
#endif
    return functions[at_2[type][sets]];
}

/* A call for one variable, with its values here. */
static Call value_call(const Instance *instance, const Variable *variable, int sets, void *values) {
    static const int32_t item = 0;
    return (Call){.function = value_function(instance, variable->part, variable->own, sets),
                  .component = instance->parts[variable->part],
                  .references = &variable->reference,
                  .values = values,
                  .n_references = 1,
                  .n_values = variable->size,
                  .is_version_3 = is_version_3(variable->part),
                  .n_items = 1,
                  .items = &item,
                  .places = &variable->place,
                  .type = variable->own};
}

static size_t size_of_type(int type) {
    static const unsigned char sizes[] = {
        [TYPE_FLOAT64] = 8, [TYPE_FLOAT32] = 4, [TYPE_INT8] = 1,  [TYPE_UINT8] = 1,
        [TYPE_INT16] = 2,   [TYPE_UINT16] = 2,  [TYPE_INT32] = 4, [TYPE_UINT32] = 4,
        [TYPE_INT64] = 8,   [TYPE_UINT64] = 8,  [TYPE_BOOLEAN] = sizeof(fmi3Boolean),
        [TYPE_BOOLEAN_2] = sizeof(fmi2Boolean)};
    return sizes[type];
}

/* Set a number of a part, in the part's own unit. An array is set as a whole. A value that is set at ticks waits for
   the next one. */
static int32_t set_number(Instance *instance, const Variable *variable, double value) {
    char before[sizeof(double)];
    double *values = variable->array < 0 ? instance->numbers : &instance->memory.saved[variable->array];
    const Call call = value_call(instance, variable, 1, values);
    const size_t size = size_of_type(variable->own);
    char *place = (char *)values + size * (size_t)variable->place;
    memcpy(before, place, size);
    if (!convert_to(&call, &value)) return fmi2Error;
    if (instance->memory.phase == STEP) {
        if (variable->way == AT_TICKS) return fmi2OK;
        if (variable->way == IN_EVENT_MODE && memcmp(before, place, size) == 0) return fmi2OK; /* no event */
    }
    int32_t status = begin_change(instance, variable->part, variable->way);
    if (!is_bad(status)) status = exchange(&instance->stepper, &call);
    if (is_bad(status))
        memcpy(place, before, size);
    else
        status = end_change(instance, variable->part, variable->way);
    return status;
}

/* Get a number of a part, in the part's own unit. One that waits for a tick is not read: it has no value before. */
static int32_t get_number(Instance *instance, const Variable *variable, double *value) {
    const int waits = variable->way == AT_TICKS;
    double *values = waits ? &instance->memory.saved[variable->array] : instance->numbers;
    const Call call = value_call(instance, variable, 0, values);
    if (!waits) memset(values, 0, (size_t)variable->size * sizeof(double));
    const int32_t status = waits ? fmi2OK : exchange(&instance->stepper, &call);
    if (!is_bad(status)) convert_from(&call, value);
    return status;
}

typedef fmi2Status GetText2(fmi2Component, const fmi2ValueReference *, size_t, fmi2String *);
typedef fmi3Status GetText3(fmi3Instance, const fmi3ValueReference *, size_t, fmi3String *, size_t);
typedef fmi2Status SetText2(fmi2Component, const fmi2ValueReference *, size_t, const fmi2String *);
typedef fmi3Status SetText3(fmi3Instance, const fmi3ValueReference *, size_t, const fmi3String *, size_t);

static int32_t get_text(Instance *instance, int part, fmi2ValueReference reference, const char **text) {
    const Function get = value_function(instance, part, TYPE_TEXT, 0);
    *text = NULL;
    if (is_version_3(part)) return (int32_t)((GetText3 *)get)(instance->parts[part], &reference, 1, text, 1);
    return (int32_t)((GetText2 *)get)(instance->parts[part], &reference, 1, text);
}

static int32_t set_text(Instance *instance, int part, int way, fmi2ValueReference reference, const char *text) {
    const Function set = value_function(instance, part, TYPE_TEXT, 1);
    int32_t status = begin_change(instance, part, way);
    if (is_bad(status)) return status;
    status = is_version_3(part) ? (int32_t)((SetText3 *)set)(instance->parts[part], &reference, 1, &text, 1)
                                : (int32_t)((SetText2 *)set)(instance->parts[part], &reference, 1, &text);
    return is_bad(status) ? status : end_change(instance, part, way);
}

static Status blame_inputs(Instance *instance, int i, int32_t status);

/* Set the inputs of a part to the present signals: in initialization mode all, later those of a step. */
static Status pass_inputs(Instance *instance, int i) {
    Stepper *s = &instance->stepper;
    const Part *part = &parts[i];
    const FmuInstance *stepped = &instance->instances[i];
    hold_inputs(s, stepped, s->stores[SIGNALS]);
    const int32_t status = instance->memory.phase == INITIALIZATION
                               ? set_values(s, &instance->calls[part->first_setter], part->n_setters, s->input_values)
                               : set_values(s, stepped->setters, stepped->n_setters, s->input_values);
    return is_bad(status) ? blame_inputs(instance, i, status) : StatusOK;
}

/* Read the signals of a part, likewise. */
static Status read_outputs(Instance *instance, int i) {
    Stepper *s = &instance->stepper;
    const Part *part = &parts[i];
    const FmuInstance *stepped = &instance->instances[i];
    const int32_t status =
        instance->memory.phase == INITIALIZATION
            ? get_values(s, &instance->calls[part->first_getter], part->n_getters, s->stores[SIGNALS])
            : get_values(s, stepped->getters, stepped->n_getters, s->stores[SIGNALS]);
    return is_bad(status) ? blame_part(instance, i, "the reading of its outputs", status) : StatusOK;
}
