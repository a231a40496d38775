/* Error control: a step is done as a whole, and again in two halves. Their difference, divided by 2^p - 1 for an
 * algorithm of order p, is the error of the halves, which are kept. error_control.py says which signals are
 * controlled, and how large an error may be.
 *
 * The step size follows a PI controller: K. Gustafsson: Control theoretic techniques for stepsize selection in
 * explicit Runge-Kutta methods, ACM Trans. Math. Softw. 17 (1991), doi:10.1145/210232.210242.
 */

/* The error of a step describes what happened within it. A step of twice the length looks just as far ahead. A
   longer one could pass over something that begins there, such as a valve that opens after a rest. */
#define LARGEST_GROWTH 2.0
#define LARGEST_CUT 0.2
#define SAFETY 0.9

/* Errors below this fraction of a signal are rounding errors. Shorter steps do not reduce them. */
#define ROUNDING_ERROR 1e-12

/* Fraction of the tolerance for errors that do not add up, and for those of a very short step. */
#define ONCE 0.1

/* Largest error, as a fraction of a signal, that does not add up in a very short step: a coupling that diverges has
   larger ones in steps of any length. */
#define DIVERGENCE 0.1

/* Number of jumps from which on a signal that nobody reads is not controlled any more. */
#define CHATTERING 10

#define LEAST_ERROR 1e-10 /* relative to the allowed one: the step grows no faster below it */

/* Save what a trial changes. */
static int32_t take(Stepper *s, const Control *c) {
    for (int32_t i = 0; i < c->n_instances; i++) {
        const int32_t failure = save_state(s, i, &c->states[i]);
        if (failure != DONE) return failure;
    }
    memcpy(c->copy, c->memory, (size_t)c->n_memory * sizeof(double));
    return DONE;
}

static int32_t put_back(Stepper *s, const Control *c) {
    for (int32_t i = 0; i < c->n_instances; i++) {
        const int32_t failure = restore_state(s, i, &c->states[i]);
        if (failure != DONE) return failure;
    }
    memcpy(c->memory, c->copy, (size_t)c->n_memory * sizeof(double));
    return DONE;
}

static double size_of(const Stepper *s, int32_t signal) { return s->largest[signal] + s->signals[signal].floor; }

/* Do the step to `end` as a whole and in halves, and compute the errors relative to the sizes of the signals. The
   whole step begins with the signals of the whole step before it: an output that is late by a part of the step is so
   in all steps, and would not differ otherwise. */
static int32_t try_doubled_step(Stepper *s, Control *c, double end) {
    const size_t size = (size_t)c->n_memory * sizeof(double);
    const double *now = s->stores[SIGNALS];
    const double time = c->time, middle = time + 0.5 * (end - time);
    if (c->coarse_time == time) memcpy(c->memory, c->coarse, size);
    int32_t failure = work_through(s, 0, time, end - time);
    if (failure != DONE) return failure;
    memcpy(c->next_coarse, c->memory, size);
    for (int32_t j = 0; j < c->n_controlled; j++) c->whole[j] = now[c->controlled[j].signal];
    failure = put_back(s, c);
    if (failure == DONE) failure = work_through(s, 0, time, middle - time);
    if (failure == DONE) failure = work_through(s, 0, middle, end - middle);
    if (failure != DONE) return failure;
    for (int32_t j = 0; j < c->n_controlled; j++) {
        const int32_t signal = c->controlled[j].signal;
        const double difference = (now[signal] - c->whole[j]) / c->divisor;
        const double error = fabs(difference) / size_of(s, signal);
        c->errors[j] = c->controlled[j].is_unread && !isfinite(error) ? 0.0 : error; /* it may be infinite */
    }
    return DONE;
}

/* What is allowed in a step. */
typedef struct {
    double adding, once; /* for errors that add up, and for those that do not */
} Allowed;

/* Return the larger quotient of error and allowed error; NaN if one is. */
static double larger(double share, double error, const Controlled *signal, Allowed allowed) {
    const double other = error / (signal->is_instant ? allowed.once : allowed.adding);
    return other > share || isnan(other) ? other : share; /* nothing is larger than NaN */
}

/* Compare the errors with what is allowed. Sets the largest quotient, and the one for a very short step. */
static void compare_errors(Control *c, double step, double *share, double *short_share) {
    const double passed = c->time - c->start + step + c->longest;
    const double unit = c->is_per_unit ? fmax(c->tolerance * step / passed, ROUNDING_ERROR) : c->tolerance;
    const double once = fmax(ONCE * c->tolerance, unit);
    const Allowed usual = {unit, once}, brief = {once, c->is_per_unit ? DIVERGENCE : once};
    const int can_jump = step <= 0.5 * c->first_rejected; /* not if it is NaN */
    *share = *short_share = 0.0;
    c->worst = 0;
    for (int32_t j = 0; j < c->n_controlled; j++) {
        const Controlled *signal = &c->controlled[j];
        const double error = c->errors[j], earlier = *short_share;
        /* A signal jumps if its error is as large as in a much longer step. One that is read may not do so twice in a
           row: an unstable coupling would look the same. */
        c->jumps[j] = can_jump && error > unit && error > 0.9 * c->first_errors[j] &&
                      (signal->is_unread || !c->jumped[j]);
        const int is_ignored = c->jumps[j] || (signal->is_unread && c->jumped[j] >= CHATTERING);
        c->judged[j] = is_ignored ? 0.0 : error;
        *share = larger(*share, c->judged[j], signal, usual);
        if (!c->is_per_unit || !signal->is_unread) /* no step becomes very short for what nobody reads */
            *short_share = larger(*short_share, c->judged[j], signal, brief);
        if (*short_share > earlier || isnan(*short_share)) c->worst = signal->signal;
    }
}

/* Propose the next step, stretched if it would leave a sliver. */
static double propose(const Control *c) {
    const double remaining = c->point - c->time, step = fmin(c->step, c->longest);
    if (step >= remaining * (1.0 - 1e-9)) return remaining;
    return 2.0 * step > remaining ? 0.5 * remaining : step;
}

static int32_t shrink(Control *c, double step, double factor) {
    c->step = step * fmax(LARGEST_CUT, fmin(factor, SAFETY));
    c->rejected++;
    return c->step < c->shortest ? TOO_SHORT : DONE;
}

static double growth_of(const Control *c, double error) {
    return fmin(LARGEST_GROWTH, fmax(LARGEST_CUT, SAFETY * pow(error, -c->exponent)));
}

/* Choose the step after one with this error, relative to the allowed one, and to that of a very short step. */
static void grow(Control *c, double step, double error, double short_error) {
    double growth = growth_of(c, error);
    if (step >= c->step) { /* else it was cut to end at a given point: its small error is no trend */
        growth = SAFETY * pow(error, -0.7 * c->exponent) * pow(c->last_error, 0.4 * c->exponent);
        growth = fmin(LARGEST_GROWTH, fmax(LARGEST_CUT, growth));
        c->last_error = error;
    }
    double next = fmax(step * growth, fmin(c->short_limit, step * growth_of(c, short_error)));
    next = fmin(fmax(next, c->shortest), fmax(c->longest, step));
    /* a step that was cut very short says little about the next one */
    c->step = step >= 0.5 * c->step ? next : fmax(next, c->step);
}

static void accept(const Stepper *s, Control *c, double end) {
    c->accepted++;
    if (c->is_per_unit) {
        memcpy(c->coarse, c->next_coarse, (size_t)c->n_memory * sizeof(double));
        c->coarse_time = end;
    }
    c->first_rejected = NAN;
    for (int32_t j = 0; j < c->n_controlled; j++) {
        const Controlled *signal = &c->controlled[j];
        const double error = c->judged[j] * size_of(s, signal->signal);
        c->jumped[j] = c->jumps[j] + (signal->is_unread ? c->jumped[j] : 0);
        c->total[j] = signal->is_instant ? fmax(c->total[j], error) : c->total[j] + error;
    }
}

static int32_t reject(Stepper *s, Control *c, double step, double error) {
    const double factor = error < INFINITY ? SAFETY * pow(error, -c->exponent) : LARGEST_CUT; /* NaN, too */
    const int32_t failure = shrink(c, step, factor);
    if (failure != DONE) return failure;
    if (step > c->short_limit) c->step = fmax(c->step, fmin(SAFETY * step, c->short_limit));
    if (isnan(c->first_rejected)) {
        memcpy(c->first_errors, c->errors, (size_t)c->n_controlled * sizeof(double));
        c->first_rejected = step;
    }
    return put_back(s, c);
}

static int all_errors_are_finite(const Control *c) {
    for (int32_t j = 0; j < c->n_controlled; j++)
        if (!isfinite(c->errors[j])) return 0;
    return 1;
}

/* Try a step to `end`. Whether it was accepted shows in the number of these; otherwise all is as before it. */
static int32_t try_step(Stepper *s, Control *c, double step, double end, int is_leap) {
    see(s);
    int32_t failure = take(s, c);
    if (failure == DONE) failure = try_doubled_step(s, c, end);
    if (failure == STEP_FAILED && s->status == fmi2Discard && !wants_end(s, s->instance)) {
        const int32_t restored = put_back(s, c);
        if (restored != DONE) return restored;
        return shrink(c, step, 0.5) == DONE ? DONE : failure;
    }
    if (failure != DONE) return failure;
    if (is_leap && all_errors_are_finite(c)) {
        c->first_rejected = NAN;
        c->accepted++;
        return DONE;
    }
    double error, short_error;
    compare_errors(c, step, &error, &short_error);
    const double judged = step > c->short_limit ? error : short_error;
    if (!(judged <= 1.0)) return reject(s, c, step, judged); /* NaN, too */
    grow(c, step, fmax(error, LEAST_ERROR), fmax(short_error, LEAST_ERROR));
    accept(s, c, end);
    return DONE;
}

int32_t stepper_control(Stepper *s, Control *c, int64_t most, int64_t room, double *rows) {
    const time_t second = time(NULL);
    s->recorded = 0;
    s->sweeps_done = 0;
    s->status = fmi2OK;
    s->failure = DONE;
    c->tried = 0;
    c->is_met = 0;
    while (c->tried < most) {
        const int64_t accepted = c->accepted;
        const double step = propose(c);
        const int is_met = step == c->point - c->time;
        const double end = is_met ? c->point : c->time + step;
        c->end = end;
        c->tried++;
        s->failure = try_step(s, c, step, end, c->is_event && is_met && step <= c->leap_limit);
        announce(s, 0);
        if (s->failure != DONE) return s->failure;
        if (c->accepted > accepted) {
            if (!are_finite(s)) return s->failure = NOT_FINITE;
            c->time = end;
            c->is_met = is_met;
            if (rows != NULL && (s->failure = record(s, end, rows)) != DONE) return s->failure;
            if (is_met || end >= c->point || end >= c->enough || (rows != NULL && s->recorded == room))
                return DONE;
        }
        if (s->stop != NULL && *s->stop) return s->failure = INTERRUPTED;
        if (time(NULL) != second) return s->failure = LATE;
    }
    return DONE;
}
