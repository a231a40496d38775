/* Get and set variables: those of the parts. */

static const char *type_name(char type) {
    return type == 'R' ? "Real" : type == 'I' ? "Integer" : type == 'B' ? "Boolean" : "String";
}

static fmi2Status check_type(const Instance *instance, fmi2ValueReference reference, char type) {
    if (reference >= N_VARIABLES)
        return report(instance, fmi2Error, "there is no variable with value reference %u.", reference);
    if (variables[reference].type == type) return fmi2OK;
    return report(instance, fmi2Error, "%s is of type %s.", variables[reference].name,
                  type_name(variables[reference].type));
}

/* Check all references of a call, and let initial values agree. */
static fmi2Status prepare_get(Instance *instance, const fmi2ValueReference vr[], size_t nvr, char type,
                              const void *value) {
    if (require(instance, INSTANTIATED | INITIALIZATION | STEP | TERMINATED, "get values") != fmi2OK)
        return fmi2Error;
    if (check_arrays(instance, nvr, vr, value) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++)
        if (check_type(instance, vr[i], type) != fmi2OK) return fmi2Error;
    return instance->memory.phase == INITIALIZATION ? settle(instance) : fmi2OK;
}

/* Check all references of a call, so that a refused call changes nothing. */
static fmi2Status prepare_set(Instance *instance, const fmi2ValueReference vr[], size_t nvr, char type,
                              const void *value) {
    if (require(instance, INSTANTIATED | INITIALIZATION | STEP, "set values") != fmi2OK) return fmi2Error;
    if (check_arrays(instance, nvr, vr, value) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        if (check_type(instance, vr[i], type) != fmi2OK) return fmi2Error;
        if (!variables[vr[i]].settable)
            return report(instance, fmi2Error, "%s cannot be set.", variables[vr[i]].name);
    }
    return fmi2OK;
}

/* The value of a variable: at communication points that of its signal, so that an input that is set then
   acts from the next step on. */
static fmi2Status get_value(Instance *instance, const Variable *variable, double *value) {
    fmi2Status status = fmi2OK;
    if (variable->signal >= 0 && instance->memory.phase & (STEP | TERMINATED))
        *value = instance->memory.now.signals[variable->signal];
    else
        status = get_number(instance, variable->part, variable->reference, variable->type, value);
    if (is_bad(status))
        return report(instance, status, "%s cannot be read.", variable->name);
    return fmi2OK;
}

static fmi2Status set_value(Instance *instance, fmi2ValueReference reference, double value) {
    const Variable *variable = &variables[reference];
    const fmi2Status status = set_number(instance, variable->part, variable->reference, variable->type, value);
    if (is_bad(status)) return report(instance, status, "%s = %.9g was refused.", variable->name, value);
    instance->settled = 0;
    if (instance->memory.phase == INSTANTIATED) {
        instance->memory.chosen[reference] = value;
        instance->memory.is_chosen[reference] = 1;
    }
    return fmi2OK;
}

#define GET_AND_SET(Name, Type, letter, from_double, to_double)                                         \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, Type value[]) { \
        Instance *instance = c;                                                                         \
        if (prepare_get(instance, vr, nvr, letter, value) != fmi2OK) return fmi2Error;                  \
        for (size_t i = 0; i < nvr; i++) {                                                              \
            double found = 0.0;                                                                         \
            const fmi2Status status = get_value(instance, &variables[vr[i]], &found);                   \
            if (status != fmi2OK) return status;                                                        \
            value[i] = from_double(found);                                                              \
        }                                                                                               \
        return fmi2OK;                                                                                  \
    }                                                                                                   \
    fmi2Status fmi2Set##Name(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,                \
                             const Type value[]) {                                                      \
        Instance *instance = c;                                                                         \
        if (prepare_set(instance, vr, nvr, letter, value) != fmi2OK) return fmi2Error;                  \
        for (size_t i = 0; i < nvr; i++) {                                                              \
            const fmi2Status status = set_value(instance, vr[i], to_double(value[i]));                  \
            if (status != fmi2OK) return status;                                                        \
        }                                                                                               \
        return fmi2OK;                                                                                  \
    }

#include "conversions.h"

GET_AND_SET(Real, fmi2Real, 'R', AS_IT_IS, AS_IT_IS)
GET_AND_SET(Integer, fmi2Integer, 'I', AS_INTEGER, AS_DOUBLE)
GET_AND_SET(Boolean, fmi2Boolean, 'B', AS_BOOLEAN, AS_TRUTH)

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
    Instance *instance = c;
    if (prepare_get(instance, vr, nvr, 'S', value) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        const Variable *variable = &variables[vr[i]];
        const fmi2Component part = instance->parts[variable->part];
        const fmi2Status status =
            CALL(instance, variable->part, GetString)(part, &variable->reference, 1, &value[i]);
        if (is_bad(status)) return report(instance, status, "%s cannot be read.", variable->name);
    }
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[]) {
    Instance *instance = c;
    if (prepare_set(instance, vr, nvr, 'S', value) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        const Variable *variable = &variables[vr[i]];
        const fmi2Component part = instance->parts[variable->part];
        const fmi2Status status =
            CALL(instance, variable->part, SetString)(part, &variable->reference, 1, &value[i]);
        if (is_bad(status)) return report(instance, status, "%s was refused.", variable->name);
        instance->settled = 0;
    }
    return fmi2OK;
}

/* ---- derivatives, which this FMU does not have ------------------------------------------- */

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t nUnknown,
                                        const fmi2ValueReference knowns[], size_t nKnown,
                                        const fmi2Real known[], fmi2Real unknown[]) {
    (void)unknowns, (void)nUnknown, (void)knowns, (void)nKnown, (void)known, (void)unknown;
    return report(c, fmi2Error, "there are no directional derivatives.");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]) {
    (void)vr, (void)nvr, (void)order, (void)value;
    return report(c, fmi2Error, "inputs are held during a step; they have no derivatives.");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]) {
    (void)vr, (void)nvr, (void)order, (void)value;
    return report(c, fmi2Error, "there are no derivatives of outputs.");
}
