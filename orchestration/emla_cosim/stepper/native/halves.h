/* Steps in which continuous instances do two halves, and those that sample one step; halved_program.py has the order. */

enum { WHOLE, FIRST_HALF, SECOND_HALF };

typedef struct {
    Stepper *stepper;
    const int32_t *parts; /* of the step, for each operation */
} Halved;

static int32_t step_in_halves(void *halved, int64_t k, double time, double length) {
    const Halved *h = halved;
    Stepper *s = h->stepper;
    const double middle = time + 0.5 * length;
    if (s->n_groups > 0) see(s);
    for (int32_t o = 0; o < s->n_operations; o++) {
        const double start = h->parts[o] == SECOND_HALF ? middle : time;
        const double end = h->parts[o] == FIRST_HALF ? middle : time + length;
        const int32_t failure = operate(s, &s->operations[o], k, start, h->parts[o] == WHOLE ? length : end - start);
        if (failure != DONE) return failure;
    }
    return are_finite(s) ? DONE : NOT_FINITE;
}

/* Do steps as stepper_run does, each operation for its part of the step. */
STEPPER_API int32_t stepper_run_halves(Stepper *stepper, const int32_t *parts, int64_t first, int64_t count,
                                       int64_t every, double *rows);

int32_t stepper_run_halves(Stepper *s, const int32_t *parts, int64_t first, int64_t count, int64_t every,
                           double *rows) {
    Halved halved = {s, parts};
    return run_steps(s, step_in_halves, &halved, first, count, every, rows);
}
