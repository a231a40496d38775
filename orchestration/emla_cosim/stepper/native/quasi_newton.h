/* Multi-vector quasi-Newton iteration: `improve` of quasi_newton.py of the master, which has the references. */

/* Learn J from all sweeps of this step, and compute the next guess. */
static void improve(int n, int sweeps, const double *residuals, const double *answers, const double *sizes,
                    const double *earlier, double *jacobian, double *basis, double *direction, double *guess) {
    double largest = 0.0;
    for (int e = 0; e < n * n; e++) jacobian[e] = earlier[e];
    for (int k = 0; k < sweeps; k++) {
        double square = 0.0;
        for (int i = 0; i < n; i++) {
            const double relative = residuals[k * n + i] / sizes[i];
            square += relative * relative;
        }
        if (square > largest) largest = square;
    }
    int used = 0;
    for (int k = sweeps - 1; k > 0; k--) {
        const int new = k * n, old = (k - 1) * n;
        double square = 0.0;
        for (int i = 0; i < n; i++) {
            direction[i] = residuals[new + i] / sizes[i] - residuals[old + i] / sizes[i];
            square += direction[i] * direction[i];
        }
        if (used == n || !(square > NOISE * NOISE * largest)) continue;
        for (int b = 0; b < used; b++) {
            double along = 0.0, norm = 0.0;
            for (int i = 0; i < n; i++) {
                along += basis[b * n + i] * direction[i];
                norm += basis[b * n + i] * basis[b * n + i];
            }
            for (int i = 0; i < n; i++) direction[i] -= along / norm * basis[b * n + i];
        }
        double rest = 0.0;
        for (int i = 0; i < n; i++) rest += direction[i] * direction[i];
        if (!(rest > FILTER * FILTER * square)) continue;
        for (int i = 0; i < n; i++) { /* the part of this difference that J does not explain yet */
            basis[used * n + i] = direction[i];
            guess[i] = answers[new + i] - answers[old + i];
            for (int j = 0; j < n; j++)
                guess[i] -= jacobian[i * n + j] * (residuals[new + j] - residuals[old + j]);
        }
        for (int i = 0; i < n; i++)
            for (int j = 0; j < n; j++) jacobian[i * n + j] += guess[i] / rest * direction[j] / sizes[j];
        used++;
    }
    const int last = (sweeps - 1) * n;
    for (int i = 0; i < n; i++) {
        guess[i] = answers[last + i];
        for (int j = 0; j < n; j++) guess[i] -= jacobian[i * n + j] * residuals[last + j];
    }
}

/* Forget what was learned. */
static void forget(int n, double *jacobian) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) jacobian[i * n + j] = i == j ? 1.0 - RELAXATION : 0.0;
}
