/* The classical Runge-Kutta method with substeps of the same length.
 *
 * The same in FMUs and in the C files that `emla export` writes, which may have another type of numbers. The order of
 * operations is that of fmublock/instance.py, so that all give the same bits. Everything is inline: where `n` and the
 * functions are constants, the compiler removes the calls.
 */

/* Computes the n derivatives k of the present states, which the context knows. */
typedef void SlopeFunction(void *context, double time, double *k);

/* Whether the step ends early, `done` seconds after its start; otherwise a substep to `next` follows. */
typedef int EndFunction(void *context, double done, double next);

/* Number of substeps no longer than `longest`. */
static inline double count_substeps(double step, double longest) {
    const double count = ceil(step / longest - SAME_COUNT);
    return count >= 1.0 ? count : 1.0;
}

/* x = x0 + factor k */
static inline void set_states(int n, double *x, const double *x0, double factor, const double *k) {
    for (int j = 0; j < n; j++) x[j] = x0[j] + factor * k[j];
}

/* Integrate the n states x over a step, in substeps no longer than `longest`.
 *
 * `memory` has room for 5 n numbers, and `ends_early` may be NULL. Returns the length of the step, which is less if it
 * ended early.
 */
static inline double runge_kutta(int n, double *x, double *memory, double time, double step, double longest,
                                 SlopeFunction *slope, EndFunction *ends_early, void *context) {
    double *x0 = memory, *k1 = x0 + n, *k2 = k1 + n, *k3 = k2 + n, *k4 = k3 + n;
    const double substeps = count_substeps(step, longest), dt = step / substeps;
    const long count = (long)substeps;
    for (long i = 0; i < count; i++) {
        const double t = time + (double)i * dt;
        for (int j = 0; j < n; j++) x0[j] = x[j];
        slope(context, t, k1);
        set_states(n, x, x0, 0.5 * dt, k1);
        slope(context, t + 0.5 * dt, k2);
        set_states(n, x, x0, 0.5 * dt, k2);
        slope(context, t + 0.5 * dt, k3);
        set_states(n, x, x0, dt, k3);
        slope(context, t + dt, k4);
        for (int j = 0; j < n; j++) k1[j] = k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j];
        set_states(n, x, x0, dt / 6.0, k1);
        if (ends_early != NULL && i + 1 < count) {
            const double done = (double)(i + 1) * dt;
            if (ends_early(context, done, (double)(i + 2) * dt)) return done;
        }
    }
    return step;
}
