/* What the toy of FMI 3.0 does wrong: these functions call those of the toy, which are renamed to good_... */
#include <string.h>

static volatile char fault[32] = "@fault:none"; /* third.py writes another name here */
#define IS(name) (strcmp((const char *)fault + 7, #name) == 0)
typedef fmi3ValueReference Reference;

FMI3_Export const char *fmi3GetVersion(void) { return IS(version) ? "3.1" : good_fmi3GetVersion(); }

FMI3_Export fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no, fmi3Boolean *event,
                                  fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
    static int bits = 32;
    fmi3Status status = good_fmi3DoStep(c, t, h, no, event, end, early, reached);
    if (IS(event)) *event = fmi3True;
    if (IS(early)) *early = fmi3True;
    if (IS(reached)) *reached += 0.25 * h;
    if (IS(leak)) *(char *)malloc(40) = 0;
    if (IS(shift) && (1 << bits) == 3) status = fmi3Error;
    return status;
}

FMI3_Export fmi3Status fmi3GetFloat64(fmi3Instance c, const Reference r[], size_t n, fmi3Float64 v[], size_t m) {
    static double more;
    const fmi3Status status = good_fmi3GetFloat64(c, r, n, v, m);
    const int between_ticks = status == fmi3Error && n == 1 && m == 1 && r[0] == POWER;
    if (between_ticks && IS(between)) v[0] = more += 1.0;
    if (between_ticks && IS(readable)) v[0] = 7.0;
    return IS(unknown) || (between_ticks && (IS(between) || IS(readable))) ? fmi3OK : status;
}

FMI3_Export fmi3Status fmi3SetFloat64(fmi3Instance c, const Reference r[], size_t n, const fmi3Float64 v[], size_t m) {
    if (IS(null)) (void)*(const volatile Reference *)r;
    if (IS(overrun)) {
        double *copy = malloc(m * sizeof *copy);
        for (size_t i = 0; i <= m; i++) copy[i] = 1.0;
        m += copy[m] < 0.0;
        free(copy);
    }
    return good_fmi3SetFloat64(c, r, n, v, m);
}

FMI3_Export fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) {
    return IS(state) ? (c && s ? fmi3OK : fmi3Error) : good_fmi3SetFMUState(c, s);
}

#define DERIVATIVE(name, fault_name)                                                                              \
    FMI3_Export fmi3Status name(fmi3Instance c, const Reference u[], size_t nu, const Reference k[], size_t nk,   \
                                const fmi3Float64 seed[], size_t ns, fmi3Float64 s[], size_t n) {                 \
        const fmi3Status status = good_##name(c, u, nu, k, nk, seed, ns, s, n);                                   \
        for (size_t i = 0; i < n && IS(fault_name); i++) s[i] *= 1.5;                                             \
        for (size_t i = 1; i < n && IS(fault_name##_second); i++) s[i] *= 1.5;                                    \
        return status;                                                                                            \
    }
DERIVATIVE(fmi3GetDirectionalDerivative, directional)
DERIVATIVE(fmi3GetAdjointDerivative, adjoint)

FMI3_Export fmi3Status fmi3GetVariableDependencies(fmi3Instance c, Reference r, size_t from[], Reference to[], size_t at[],
                                                   fmi3DependencyKind k[], size_t n) {
    const fmi3Status status = good_fmi3GetVariableDependencies(c, r, from, to, at, k, n);
    if (IS(element) && n) at[0] += 7;
    return status;
}

FMI3_Export fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const Reference r[], size_t n, fmi3Float64 v[],
                                              fmi3IntervalQualifier q[]) {
    const fmi3Status status = good_fmi3GetIntervalDecimal(c, r, n, v, q);
    if (IS(interval)) v[0] *= 2.0;
    return status;
}

FMI3_Export fmi3Status fmi3SetClock(fmi3Instance c, const Reference r[], size_t n, const fmi3Clock v[]) {
    if (IS(clock_leak)) *(char *)malloc(40) = 0;
    const fmi3Status status = good_fmi3SetClock(c, r, n, v);
    return IS(any_mode) ? fmi3OK : status;
}

FMI3_Export fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *more, fmi3Boolean *ends, fmi3Boolean *nominals,
                                                fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *next) {
    const fmi3Status status = good_fmi3UpdateDiscreteStates(c, more, ends, nominals, states, defined, next);
    if (IS(endless)) *more = fmi3True;
    return status;
}
