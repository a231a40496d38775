/* Initial values of a loop x = F(x): Newton's method with derivatives from differences.
 *
 * The first guess is the solution for the start values of the system, as the master found it. If it still
 * solves the loop, it is taken as it is, so that the results have the bits of the master. With other start
 * values the solution agrees with the master's to rounding errors.
 */

#define NO_SOLUTION ((Status)100) /* besides the statuses of FMI */

/* Solve A x = b by elimination with row pivoting, in place; 0 if A is singular. The rows of A are scaled. */
static int solve_linear(int n, double *A, double *b) {
    for (int k = 0; k < n; k++) {
        int pivot = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(A[i * n + k]) > fabs(A[pivot * n + k])) pivot = i;
        if (!(fabs(A[pivot * n + k]) > 1e-13)) return 0;
        for (int j = 0; j < n && pivot != k; j++) {
            const double swap = A[k * n + j];
            A[k * n + j] = A[pivot * n + j];
            A[pivot * n + j] = swap;
        }
        const double swap = b[k];
        b[k] = b[pivot];
        b[pivot] = swap;
        for (int i = k + 1; i < n; i++) {
            const double factor = A[i * n + k] / A[k * n + k];
            for (int j = k; j < n; j++) A[i * n + j] -= factor * A[k * n + j];
            b[i] -= factor * b[k];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++) b[k] -= A[k * n + j] * b[j];
        b[k] /= A[k * n + k];
    }
    return 1;
}

typedef Status Answer(Instance *instance, const Loop *loop, const double *x, double *found);

static double weigh(int n, const double *x, const double *floors, const double *difference) {
    double largest = 0.0;
    for (int i = 0; i < n; i++) {
        const double size = fabs(difference[i]) / (fabs(x[i]) + floors[i]);
        if (!(size <= largest)) largest = isfinite(size) ? size : HUGE_VAL;
    }
    return largest;
}

/* Compute the correction that solves (1 - F') dx = gap, with derivatives at x, where F(x) = found. */
static Status correct(Instance *instance, const Loop *loop, Answer *answer, const double *floors,
                          const double *x, const double *found, double *correction) {
    const int n = loop->n_coupling;
    double A[ROOM(MOST_INITIAL * MOST_INITIAL)], moved[ROOM(MOST_INITIAL)], there[ROOM(MOST_INITIAL)];
    for (int j = 0; j < n; j++) {
        memcpy(moved, x, (size_t)n * sizeof(double));
        moved[j] += LOOP_DIFFERENCE * (fabs(x[j]) + floors[j]);
        const double step = moved[j] - x[j];
        const Status status = answer(instance, loop, moved, there);
        if (status != StatusOK) return status;
        for (int i = 0; i < n; i++) {
            const double scale = (fabs(x[j]) + floors[j]) / (fabs(x[i]) + floors[i]);
            A[i * n + j] = ((i == j ? 1.0 : 0.0) - (there[i] - found[i]) / step) * scale;
        }
    }
    for (int i = 0; i < n; i++) correction[i] = (found[i] - x[i]) / (fabs(x[i]) + floors[i]);
    if (!solve_linear(n, A, correction)) return NO_SOLUTION;
    for (int i = 0; i < n; i++) correction[i] *= fabs(x[i]) + floors[i];
    return StatusOK;
}

/* Solve x = F(x) from the guess x; NO_SOLUTION if no solution is found. */
static Status solve_loop(Instance *instance, const Loop *loop, Answer *answer, const double *floors,
                             double *x) {
    const int n = loop->n_coupling;
    double found[ROOM(MOST_INITIAL)], gap[ROOM(MOST_INITIAL)], correction[ROOM(MOST_INITIAL)];
    double tried[ROOM(MOST_INITIAL)];
    double last = HUGE_VAL; /* size of the correction before */
    Status status = answer(instance, loop, x, found);
    for (int iteration = 0; iteration < LOOP_ITERATIONS && status == StatusOK; iteration++) {
        for (int i = 0; i < n; i++) gap[i] = found[i] - x[i];
        const double size = weigh(n, x, floors, gap);
        if (size <= LOOP_TOLERANCE) return StatusOK;
        if (size == HUGE_VAL) return NO_SOLUTION;
        status = correct(instance, loop, answer, floors, x, found, correction);
        if (status != StatusOK) return status;
        double part = 1.0;
        for (int k = 0; k < LOOP_HALVINGS && status == StatusOK; k++, part *= 0.5) {
            for (int i = 0; i < n; i++) tried[i] = x[i] + part * correction[i];
            status = answer(instance, loop, tried, found);
            for (int i = 0; i < n; i++) gap[i] = found[i] - tried[i];
            if (weigh(n, x, floors, gap) < size) break;
        }
        const double moved = weigh(n, x, floors, correction);
        memcpy(x, tried, (size_t)n * sizeof(double));
        /* small corrections that stop shrinking are rounding errors */
        if (moved <= LOOP_TOLERANCE || (moved <= LOOP_ROUGH && moved >= 0.5 * last)) return status;
        last = moved;
    }
    return status == StatusOK ? NO_SOLUTION : status;
}
