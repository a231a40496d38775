/* Functions of the periodic input clock; see fmi3_clocked.h. */

static Status check_clock(const Instance *instance, const ValueReference vr[], size_t nvr, const void *values) {
    if (check_arrays(instance, nvr, vr, values) != StatusOK) return StatusError;
    for (size_t i = 0; i < nvr; i++)
        if (vr[i] != CLOCK_REFERENCE)
            return report(instance, StatusError, "there is no clock with value reference %u.", (unsigned)vr[i]);
    return StatusOK;
}

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Clock values[]) {
    Instance *instance = c;
    if (require(instance, CO_SIMULATION_EVENT, "get a clock") != StatusOK) return fmi3Error;
    if (check_clock(instance, vr, nvr, values) != StatusOK) return fmi3Error;
    for (size_t i = 0; i < nvr; i++) values[i] = instance->now.ticking != 0;
    return fmi3OK;
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, const fmi3Clock values[]) {
    Instance *instance = c;
    State *now = &instance->now;
    if (require(instance, CO_SIMULATION_EVENT, "set a clock") != StatusOK) return fmi3Error;
    if (check_clock(instance, vr, nvr, values) != StatusOK) return fmi3Error;
    for (size_t i = 0; i < nvr; i++) {
        if (!values[i] && now->ticking) return report(instance, fmi3Error, "the clock cannot be deactivated.");
        if (values[i] && !now->ticking && !is_tick(now, now->time))
            return report(instance, fmi3Error, "the clock ticks at t = %.9g s, but the instance is at t = %.9g s.",
                          next_tick(now), now->time);
        now->ticking |= values[i];
    }
    return fmi3OK;
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[]) {
    if (require(c, INITIALIZATION | CO_SIMULATION_EVENT, "get an interval") != StatusOK) return fmi3Error;
    if (check_clock(c, vr, nvr, intervals) != StatusOK) return fmi3Error;
    if (check_arrays(c, nvr, vr, qualifiers) != StatusOK) return fmi3Error;
    for (size_t i = 0; i < nvr; i++) intervals[i] = CLOCK_INTERVAL, qualifiers[i] = fmi3IntervalUnchanged;
    return fmi3OK;
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3Float64 shifts[]) {
    if (require(c, INITIALIZATION, "get a shift") != StatusOK) return fmi3Error;
    if (check_clock(c, vr, nvr, shifts) != StatusOK) return fmi3Error;
    for (size_t i = 0; i < nvr; i++) shifts[i] = CLOCK_INTERVAL;
    return fmi3OK;
}
