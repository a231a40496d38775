/* Functions of FMI 3.0 for what no FMU here has. */

static fmi3Status lacks(fmi3Instance c, const char *what) {
    return report(c, fmi3Error, "this FMU has no %s.", what);
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { return lacks(c, "structural parameters"); }

fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { return lacks(c, "structural parameters"); }

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clockReference,
                                      fmi3Float64 activationTime) {
    (void)clockReference, (void)activationTime;
    return lacks(c, "scheduled execution");
}

/* A call for no clocks is no error. */
static fmi3Status refuse_clocks(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr) {
    (void)vr;
#ifdef CLOCK_INTERVAL
    return nvr == 0 ? fmi3OK : lacks(c, "intervals and shifts to set, or as fractions");
#else
    return nvr == 0 ? fmi3OK : lacks(c, "clocks");
#endif
}

#define NO_CLOCKS_1(Name, A)                                                                       \
    fmi3Status fmi3##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, A a[]) {      \
        (void)a;                                                                                   \
        return refuse_clocks(c, vr, nvr);                                                          \
    }
#define NO_CLOCKS_2(Name, A, B)                                                                    \
    fmi3Status fmi3##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, A a[], B b[]) { \
        (void)a, (void)b;                                                                          \
        return refuse_clocks(c, vr, nvr);                                                          \
    }

#ifdef CLOCK_INTERVAL
#include "fmi3_clock_functions.h"
#else
NO_CLOCKS_1(GetClock, fmi3Clock)
NO_CLOCKS_1(SetClock, const fmi3Clock)
NO_CLOCKS_2(GetIntervalDecimal, fmi3Float64, fmi3IntervalQualifier)
NO_CLOCKS_1(GetShiftDecimal, fmi3Float64)
#endif
NO_CLOCKS_2(GetShiftFraction, fmi3UInt64, fmi3UInt64)
NO_CLOCKS_1(SetIntervalDecimal, const fmi3Float64)
NO_CLOCKS_2(SetIntervalFraction, const fmi3UInt64, const fmi3UInt64)
NO_CLOCKS_1(SetShiftDecimal, const fmi3Float64)
NO_CLOCKS_2(SetShiftFraction, const fmi3UInt64, const fmi3UInt64)

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t nvr, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]) {
    (void)counters, (void)resolutions, (void)qualifiers;
    return refuse_clocks(c, vr, nvr);
}
