/* Get and set variables: those of the parts. */

/* The types for the host as letters, as the headers of all FMUs here have them: that of the stepper, and its name. */
static const struct {
    char letter, type;
    const char *name;
} host_types[] = {
    {'R', TYPE_FLOAT64, TYPE_NAME('R')}, {'I', TYPE_INT32, TYPE_NAME('I')}, {'E', TYPE_INT64, TYPE_NAME('E')},
    {'B', TYPE_BOOLEAN, TYPE_NAME('B')}, {'S', TYPE_TEXT, "String"},        {'r', TYPE_FLOAT32, "Float32"},
    {'b', TYPE_INT8, "Int8"},            {'c', TYPE_UINT8, "UInt8"},        {'s', TYPE_INT16, "Int16"},
    {'t', TYPE_UINT16, "UInt16"},        {'u', TYPE_UINT32, "UInt32"},      {'U', TYPE_UINT64, "UInt64"}};

static int place_of_type(char letter) {
    int k = 0;
    while (host_types[k].letter != letter) k++;
    return k;
}

static int type_of(char letter) { return host_types[place_of_type(letter)].type; }

static const char *type_name(char letter) { return host_types[place_of_type(letter)].name; }

#define LARGEST_EXACT 9007199254740992.0 /* above 2^53, doubles leave out whole numbers */

/* Whether a value from or to the host fits into a type of which no digit may be lost. */
static int fits_exactly(int type, double value) {
    return fits_type(type, value) && ((type != TYPE_INT64 && type != TYPE_UINT64) || fabs(value) < LARGEST_EXACT);
}

static Status check_type(const Instance *instance, ValueReference reference, char type) {
    if (reference >= N_VARIABLES)
        return report(instance, StatusError, "there is no variable with value reference %u.", (unsigned)reference);
    const char own = variables[reference].type;
    if (own == type) return StatusOK;
    return report(instance, StatusError, "%s is of type %s.", variables[reference].name,
                  type_name(own));
}

/* Check that the host has as many values as variables, which are scalars. */
static Status check_count(const Instance *instance, size_t nvr, size_t n) {
    if (n == nvr) return StatusOK;
    return report(instance, StatusError, "%u values were announced for %u variables.", (unsigned)n, (unsigned)nvr);
}

/* Check all references of a call, and let initial values agree. */
static Status prepare_get(Instance *instance, const ValueReference vr[], size_t nvr, char type,
                          const void *values, size_t n) {
    if (require(instance, INSTANTIATED | INITIALIZATION | STEP | TERMINATED, "get values") != StatusOK)
        return StatusError;
    if (check_arrays(instance, nvr, vr, values) != StatusOK) return StatusError;
    if (check_count(instance, nvr, n) != StatusOK) return StatusError;
    for (size_t i = 0; i < nvr; i++)
        if (check_type(instance, vr[i], type) != StatusOK) return StatusError;
    return instance->memory.phase == INITIALIZATION ? settle(instance) : StatusOK;
}

/* Check all references of a call, so that a refused call changes nothing. */
static Status prepare_set(Instance *instance, const ValueReference vr[], size_t nvr, char type,
                          const void *values, size_t n) {
    if (require(instance, INSTANTIATED | INITIALIZATION | STEP, "set values") != StatusOK) return StatusError;
    if (check_arrays(instance, nvr, vr, values) != StatusOK) return StatusError;
    if (check_count(instance, nvr, n) != StatusOK) return StatusError;
    for (size_t i = 0; i < nvr; i++) {
        if (check_type(instance, vr[i], type) != StatusOK) return StatusError;
        if (!variables[vr[i]].settable)
            return report(instance, StatusError, "%s cannot be set.", variables[vr[i]].name);
        if (variables[vr[i]].settable == 2 && instance->memory.phase == STEP)
            return report(instance, StatusError, "%s cannot be set after initialization.", variables[vr[i]].name);
    }
    return StatusOK;
}

/* The value of a variable: at communication points that of its signal, so that an input that is set then
   acts from the next step on. */
static Status get_value(Instance *instance, const Variable *variable, double *value) {
    const int runs = instance->memory.phase & (STEP | TERMINATED);
    int32_t status = fmi2OK;
    if (variable->part < 0)
        *value = reached_time(instance);
    else if (variable->signal >= 0 && runs)
        *value = instance->stepper.stores[SIGNALS][variable->signal];
    else if (variable->kept >= 0 && runs)
        *value = instance->memory.saved[variable->kept];
    else
        status = get_number(instance, variable, value);
    if (is_bad(status))
        return report(instance, (Status)status, "%s cannot be read.", variable->name);
    if (fits_exactly(type_of(variable->type), *value)) return StatusOK;
    return report(instance, StatusError, "%s = %.17g does not fit into its type, %s.", variable->name, *value,
                  type_name(variable->type));
}

static Status set_value(Instance *instance, ValueReference reference, double value) {
    const Variable *variable = &variables[reference];
    if (!fits_exactly(variable->own, value))
        return report(instance, StatusError, "%s = %.17g does not fit into the type of %s, %s.", variable->name,
                      value, parts[variable->part].name, own_type_name(variable->own));
    const int32_t status = set_number(instance, variable, value);
    if (is_bad(status)) return report(instance, (Status)status, "%s = %.9g was refused.", variable->name, value);
    instance->settled = 0;
    if (instance->memory.phase == INSTANTIATED) {
        instance->memory.chosen[reference] = value;
        instance->memory.is_chosen[reference] = 1;
    }
    return StatusOK;
}

#define GET_AND_SET(Name, Type, letter, from_double, to_double)                                               \
    Status FMI(Get##Name)(Handle c, const ValueReference vr[], size_t nvr, Type values[] COUNTED(n)) {        \
        Instance *instance = c;                                                                               \
        if (prepare_get(instance, vr, nvr, letter, values, COUNT_OF(n, nvr)) != StatusOK) return StatusError; \
        for (size_t i = 0; i < nvr; i++) {                                                                    \
            double found = 0.0;                                                                               \
            const Status status = get_value(instance, &variables[vr[i]], &found);                             \
            if (status != StatusOK) return status;                                                            \
            values[i] = from_double(found);                                                                   \
        }                                                                                                     \
        return StatusOK;                                                                                      \
    }                                                                                                         \
    Status FMI(Set##Name)(Handle c, const ValueReference vr[], size_t nvr, const Type values[] COUNTED(n)) {  \
        Instance *instance = c;                                                                               \
        if (prepare_set(instance, vr, nvr, letter, values, COUNT_OF(n, nvr)) != StatusOK) return StatusError; \
        for (size_t i = 0; i < nvr; i++) {                                                                    \
            const Status status = set_value(instance, vr[i], to_double(values[i]));                           \
            if (status != StatusOK) return status;                                                            \
        }                                                                                                     \
        return StatusOK;                                                                                      \
    }

#include "conversions.h"

Status FMI(GetString)(Handle c, const ValueReference vr[], size_t nvr, String values[] COUNTED(n)) {
    Instance *instance = c;
    if (prepare_get(instance, vr, nvr, 'S', values, COUNT_OF(n, nvr)) != StatusOK) return StatusError;
    for (size_t i = 0; i < nvr; i++) {
        const Variable *variable = &variables[vr[i]];
        const int32_t status = get_text(instance, variable->part, variable->reference, &values[i]);
        if (is_bad(status)) return report(instance, (Status)status, "%s cannot be read.", variable->name);
    }
    return StatusOK;
}

Status FMI(SetString)(Handle c, const ValueReference vr[], size_t nvr, const String values[] COUNTED(n)) {
    Instance *instance = c;
    if (prepare_set(instance, vr, nvr, 'S', values, COUNT_OF(n, nvr)) != StatusOK) return StatusError;
    for (size_t i = 0; i < nvr; i++) {
        const Variable *variable = &variables[vr[i]];
        if (values[i] == NULL) return report(instance, StatusError, "the text for %s is NULL.", variable->name);
        const int32_t status =
            set_text(instance, variable->part, variable->way, variable->reference, values[i]);
        if (is_bad(status)) return report(instance, (Status)status, "%s was refused.", variable->name);
        instance->settled = 0;
    }
    return StatusOK;
}
