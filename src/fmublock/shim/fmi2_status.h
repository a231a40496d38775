/* The status of steps. reached_time and has_ended are defined before it. */

/* Steps are never asynchronous, so there is nothing to cancel and no pending status. */
fmi2Status fmi2CancelStep(fmi2Component c) { return report(c, fmi2Error, "no step is pending."); }

static fmi2Status no_status(fmi2Component c) {
    return report(c, fmi2Discard, "this status is not available.");
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
    (void)s, (void)value;
    return no_status(c);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    if (s != fmi2LastSuccessfulTime) return no_status(c);
    if (check_place(c, value, "the status") != fmi2OK) return fmi2Error;
    *value = reached_time(c);
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    (void)s, (void)value;
    return no_status(c);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    if (s != fmi2Terminated) return no_status(c);
    if (check_place(c, value, "the status") != fmi2OK) return fmi2Error;
    *value = has_ended(c) ? fmi2True : fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    (void)s, (void)value;
    return no_status(c);
}
