/* One step of a program: all that an exported system needs of the stepper. */
#include "stepper.h"

#include <math.h>
#include <string.h>

#include "calls.h"

#include "clocks.h"

#include "events.h"

#include "exchange.h"

#define RELAXATION 0.1 /* while nothing is known of the Jacobian; as quasi_newton.py, which has the equations */
#define NOISE 1e-10    /* changes of the residual below this fraction of it are rounding errors */
#define FILTER 1e-3    /* a difference is used if this fraction of it is orthogonal to newer ones */

#include "quasi_newton.h"

#include "solve.h"

#include "divide.h"

static double point(const Stepper *s, int64_t k) {
    const double time = (s->clock.first + (double)k * s->clock.per_step) / s->clock.denominator;
    return time < s->last_point ? time : s->last_point;
}

static int divides(int64_t every, int64_t k) { return every == 1 || k % every == 0; }

/* Do one operation of step k, from `time` of this length. */
ALWAYS_INLINE static int32_t operate(Stepper *s, const Operation *operation, int64_t k, double time, double length) {
    double start = time, span = length;
    if (!divides(operation->every, k + 1)) return DONE;
    if (operation->every > 1) {
        start = point(s, k + 1 - operation->every);
        span = point(s, k + 1) - start;
    }
    switch (operation->call) {
        case SET_INPUTS: return set_inputs(s, operation->target, operation->store, start, span);
        case DO_STEP: return do_step(s, operation->target, start, span);
        case END_STEP: return end_step(s, operation->target, start, span);
        case GET_OUTPUTS: shift(s, operation->target, time + length); return get_outputs(s, operation->target);
        case DIVIDE_STEP: return STEPPER_DIVISIONS ? divide_step(s, operation->target, start, span) : DONE;
        case END_DIVIDED_STEP: return STEPPER_DIVISIONS ? end_divided_step(s, operation->target, start, span) : DONE;
        case SOLVE: return STEPPER_GROUPS ? solve(s, operation->target, time, length, s->halvings) : DONE;
        default: combine(s, &s->combinations[operation->target]); return DONE;
    }
}

/* Do step k, from `time` of this length. */
ALWAYS_INLINE static int32_t work_through(Stepper *s, int64_t k, double time, double length) {
    if (s->n_groups > 0) see(s);
    for (int32_t o = 0; o < s->n_operations; o++) {
        const int32_t failure = operate(s, &s->operations[o], k, time, length);
        if (failure != DONE) return failure;
    }
    return DONE;
}

static int32_t step(Stepper *s, int64_t k, double time, double length) {
    const int32_t failure = work_through(s, k, time, length);
    if (failure != DONE) return failure;
    announce(s, 0);
    return are_finite(s) ? DONE : NOT_FINITE;
}

int32_t stepper_step(Stepper *s, int64_t k) {
    const double time = point(s, k);
    return s->failure = step(s, k, time, point(s, k + 1) - time);
}
