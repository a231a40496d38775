/* Steps in which continuous instances do two halves; halved_program.py has the order of the operations.
 *
 * They are in a translation unit of their own, so that the compiler inlines functions of other steps as before.
 */
#ifdef _WIN32
#define STEPPER_API __declspec(dllexport)
#else
#define STEPPER_API __attribute__((visibility("default")))
#endif

#define stepper_step stepper_step_beside_halves /* the other unit has a function of this name */

#include "step.h"

enum { WHOLE, FIRST_HALF, SECOND_HALF, SAVE, RESTORE, SWAP };

typedef struct {
    const int32_t *parts;      /* of the step, for each operation, or what else is done */
    const int32_t *continuous; /* instances that do halves */
    SavedState *states;        /* of them */
    double *kept;              /* signals, previous signals, and their times, from the start of the step */
    int32_t n_continuous, n_instances;
} Halves;

extern STEPPER_API const size_t halves_size[];
const size_t halves_size[] = {sizeof(Halves)};

static int32_t keep(Stepper *s, const Halves *h) {
    const size_t n = (size_t)s->n_signals, m = (size_t)h->n_instances;
    for (int32_t c = 0; c < h->n_continuous; c++) {
        const int32_t failure = save_state(s, h->continuous[c], &h->states[h->continuous[c]]);
        if (failure != DONE) return failure;
    }
    memcpy(h->kept, s->stores[SIGNALS], n * sizeof(double));
    memcpy(h->kept + n, s->stores[PREVIOUS], n * sizeof(double));
    memcpy(h->kept + 2 * n, s->at, m * sizeof(double));
    memcpy(h->kept + 2 * n + m, s->before, m * sizeof(double));
    return DONE;
}

static void swap_values(double *a, double *b, int32_t count) {
    for (int32_t k = 0; k < count; k++) {
        const double value = a[k];
        a[k] = b[k];
        b[k] = value;
    }
}

/* Exchange the signals of an instance with those kept from the start of the step, and the other way round. */
static void swap_signals(Stepper *s, const Halves *h, int32_t i) {
    const FmuInstance *instance = &s->instances[i];
    const int32_t first = instance->first_output, n = s->n_signals;
    swap_values(s->stores[SIGNALS] + first, h->kept + first, instance->n_outputs);
    swap_values(s->stores[PREVIOUS] + first, h->kept + n + first, instance->n_outputs);
    swap_values(&s->at[i], h->kept + 2 * n + i, 1);
    swap_values(&s->before[i], h->kept + 2 * n + h->n_instances + i, 1);
}

static int32_t go_back(Stepper *s, const Halves *h) {
    for (int32_t c = 0; c < h->n_continuous; c++) {
        const int32_t i = h->continuous[c], failure = restore_state(s, i, &h->states[i]);
        if (failure != DONE) return failure;
        swap_signals(s, h, i);
    }
    return DONE;
}

static int32_t step_in_halves(Stepper *s, const Halves *h, int64_t k, double time, double length) {
    const double middle = time + 0.5 * length;
    if (s->n_groups > 0) see(s);
    for (int32_t o = 0; o < s->n_operations; o++) {
        const Operation *operation = &s->operations[o];
        int32_t failure = DONE;
        switch (h->parts[o]) {
            case WHOLE: failure = operate(s, operation, k, time, length); break;
            case FIRST_HALF: failure = operate(s, operation, k, time, middle - time); break;
            case SECOND_HALF: failure = operate(s, operation, k, middle, time + length - middle); break;
            case SAVE: failure = keep(s, h); break;
            case RESTORE: failure = go_back(s, h); break;
            default: swap_signals(s, h, operation->target);
        }
        if (failure != DONE) return failure;
    }
    return are_finite(s) ? DONE : NOT_FINITE;
}

/* Do `count` steps from step `first` on in halves, and fill rows of time and signals after each. Returns why it
 * ended, as stepper_run does. */
STEPPER_API int32_t stepper_run_halves(Stepper *s, const Halves *h, int64_t first, int64_t count, double *rows);

int32_t stepper_run_halves(Stepper *s, const Halves *h, int64_t first, int64_t count, double *rows) {
    s->reached = first;
    s->recorded = s->sweeps_done = 0;
    s->status = fmi2OK;
    s->failure = DONE;
    for (int64_t k = first; k < first + count; k++) {
        const double time = point(s, k), end = point(s, k + 1);
        s->failure = step_in_halves(s, h, k, time, end - time);
        if (s->failure != DONE) return s->failure;
        s->reached = k + 1;
        *rows++ = end;
        memcpy(rows, s->stores[SIGNALS], (size_t)s->n_signals * sizeof(double));
        rows += s->n_signals;
        s->recorded++;
        if (s->stop != NULL && *s->stop) return s->failure = INTERRUPTED;
    }
    return DONE;
}
