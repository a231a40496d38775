/* Error control of random systems, for stepper_host.c.
 *
 * Each system is run twice in the same way, in parts, and by single trials; all must give the same bits. After a
 * trial that was rejected, all memory and all toys must be as before it. The roles of signals are random.
 */
#ifndef STEPPER_TRIALS_H
#define STEPPER_TRIALS_H

enum { SINGLE_TRIALS = IN_PARTS + 1 };
enum { MOST_TRIALS = 300, MOST_AT_ONCE = 6 };

/* What a run goes to: points at equal distances, some of which are events. */
typedef struct {
    double start, distance;
    int32_t n_points, next, records;
    uint32_t events; /* bits */
} Course;

static Control *build_control(System *system) {
    Dice *dice = &system->dice;
    const Stepper *s = &system->stepper;
    Control *c = own(system, 1, sizeof *c);
    Controlled signals[MOST_INSTANCES * MOST_VALUES];
    int32_t n = 0;
    for (int32_t k = 0; k < s->n_signals; k++)
        if (happens(dice, 0.6))
            signals[n++] = (Controlled){.signal = k,
                                        .is_unread = happens(dice, 0.4),
                                        .is_instant = happens(dice, 0.2)};
    const double first = system->step * uniform(dice, 0.05, 1.0);
    const int32_t order = between(dice, 1, 2), is_per_unit = happens(dice, 0.5);
    *c = (Control){.controlled = own_copy(system, signals, n, sizeof *signals),
                   .n_controlled = n,
                   .tolerance = pow(10.0, uniform(dice, -4.0, -1.0)),
                   .divisor = order == 1 ? 1.0 : 3.0,
                   .start = s->at[0],
                   .leap_limit = 0.05 * first,
                   .short_limit = (happens(dice, 0.5) ? 1e-1 : 1e-3) * first,
                   .shortest = pow(10.0, uniform(dice, -5.0, -1.0)) * first,
                   .longest = system->step, /* longer ones are steps of several */
                   .n_instances = system->n_instances,
                   .states = system->trial_states,
                   .memory = system->memory,
                   .copy = own_doubles(system, system->n_memory),
                   .coarse = own_doubles(system, system->n_memory),
                   .next_coarse = own_doubles(system, system->n_memory),
                   .n_memory = system->n_memory,
                   .whole = own_doubles(system, n),
                   .errors = own_doubles(system, n),
                   .judged = own_doubles(system, n),
                   .total = own_equal(system, n, 0.0),
                   .first_errors = own_doubles(system, n),
                   .jumps = own(system, (size_t)n, sizeof(int32_t)),
                   .jumped = own(system, (size_t)n, sizeof(int32_t)),
                   .time = s->at[0],
                   .step = first,
                   .last_error = 1.0,
                   .exponent = 1.0 / (order + !is_per_unit),
                   .first_rejected = (double)NAN,
                   .coarse_time = (double)NAN,
                   .is_per_unit = is_per_unit};
    for (int32_t j = 0; j < n; j++) c->jumped[j] = 0;
    system->control = c;
    return c;
}

static void set_point(Control *c, const Course *course) {
    c->point = course->start + (course->next + 1) * course->distance;
    c->is_event = (int32_t)(course->events >> (course->next % 32) & 1u);
}

/* Check what a call of stepper_control left. */
static void check_trials(const System *system, const Control *c, const Control *before, int64_t most, int64_t room,
                         const double *rows) {
    const Stepper *s = &system->stepper;
    const int64_t accepted = c->accepted - before->accepted, judged = accepted + c->rejected - before->rejected;
    const int is_over = can_go_on(s->failure) || s->failure == TOO_SHORT;
    REQUIRE(c->tried >= 1 && c->tried <= most, "the number of trials is wrong");
    REQUIRE(judged == c->tried || (!is_over && judged >= c->tried - 1), "a trial is neither accepted nor rejected");
    REQUIRE(c->time >= before->time && c->time <= c->point, "the time is not on the way to the point");
    REQUIRE(!c->is_met == (c->time != c->point), "whether the point is met is wrong");
    occurred[LEAPS] += accepted && c->is_event && c->is_met && c->time - before->time <= c->leap_limit;
    occurred[TRIALS_LATE] += s->failure == LATE;
    occurred[TRIALS_INTERRUPTED] += s->failure == INTERRUPTED;
    const int64_t complete = accepted - (s->failure == NOT_FINITE);
    REQUIRE(s->recorded == (rows == NULL ? 0 : complete - (s->failure == OBSERVE_FAILED)), "wrong number of rows");
    const size_t width = width_of(s);
    for (size_t v = (size_t)s->recorded * width; v < (size_t)room * width; v++)
        REQUIRE(is_unused(rows[v]), "more rows are written than recorded");
    if (s->recorded > 0 && s->failure != OBSERVE_FAILED)
        REQUIRE(rows[(size_t)(s->recorded - 1) * width] == c->time, "the time of a row is wrong");
    if (s->failure == DONE)
        REQUIRE(c->is_met || c->tried == most || c->time >= c->enough || (rows != NULL && s->recorded == room),
                "it ends without a reason");
    if (s->failure == TOO_SHORT)
        REQUIRE(c->step < c->shortest && !system->must_fail, "the step is long enough");
    else
        check_failure(system);
}

/* Memory and toys as they must be after a trial that is rejected. */
typedef struct {
    double *memory;
    State states[MOST_INSTANCES];
} Picture;

static Picture take_picture(System *system) {
    Picture picture = {.memory = allocate((size_t)system->n_memory, sizeof(double))};
    see(&system->stepper); /* as each trial does first */
    memcpy(picture.memory, system->memory, (size_t)system->n_memory * sizeof(double));
    for (int32_t i = 0; i < system->n_instances; i++) picture.states[i] = system->toys[i].state;
    return picture;
}

static void compare_picture(const System *system, const Picture *picture) {
    const size_t size = (size_t)system->n_memory * sizeof(double);
    REQUIRE(memcmp(picture->memory, system->memory, size) == 0, "a rejected trial leaves other values");
    for (int32_t i = 0; i < system->n_instances; i++)
        REQUIRE(memcmp(&picture->states[i], &system->toys[i].state, sizeof(State)) == 0,
                "a rejected trial leaves another state");
}

/* Call stepper_control once with room for exactly what it may fill, and add rows to `all`. */
static int32_t try_part(System *system, Control *c, int64_t most, int64_t room, Outcome *all) {
    Stepper *s = &system->stepper;
    double *rows = room > 0 ? allocate((size_t)room * width_of(s), sizeof(double)) : NULL;
    const Control before = *c;
    Picture picture = take_picture(system);
    const int32_t failure = stepper_control(s, c, most, room, rows);
    REQUIRE(failure == s->failure, "no such failure");
    if (!system->is_lost) {
        check_trials(system, c, &before, most, room, rows);
        if (can_go_on(failure) && c->accepted == before.accepted) compare_picture(system, &picture);
    }
    if (all != NULL) {
        const size_t filled = (size_t)s->recorded * width_of(s);
        if (filled > 0) memcpy(all->rows + all->n_row_values, rows, filled * sizeof(double));
        all->n_row_values += filled;
        all->recorded += s->recorded;
        all->sweeps += s->sweeps_done;
    }
    free(picture.memory);
    free(rows);
    return failure;
}

/* What the program in Python does at each point. */
static void meet(System *system, const Control *c, Course *course) {
    Stepper *s = &system->stepper;
    if (!c->is_met) return;
    course->next++;
    if (!c->is_event) return;
    occurred[EVENTS_MET]++;
    for (int32_t i = 0; i < system->n_instances; i++) s->at[i] = s->before[i] = c->time;
}

static int32_t draw_room(System *system, int way) {
    return way == WHOLE ? MOST_TRIALS : between(&system->ways, 1, MOST_AT_ONCE);
}

/* Keep what must not depend on the way. */
static void copy_control(Outcome *outcome, const System *system, const Control *c) {
    const double numbers[] = {c->time, c->step, c->last_error, (double)c->rejected};
    const size_t n_numbers = sizeof numbers / sizeof *numbers, n_memory = (size_t)system->n_memory;
    outcome->n_vector_values = n_memory + (size_t)c->n_controlled + n_numbers;
    outcome->vectors = allocate(outcome->n_vector_values, sizeof(double));
    memcpy(outcome->vectors, numbers, sizeof numbers);
    memcpy(outcome->vectors + n_numbers, system->memory, n_memory * sizeof(double));
    memcpy(outcome->vectors + n_numbers + n_memory, c->total, (size_t)c->n_controlled * sizeof(double));
}

static Outcome control_errors(uint64_t seed, int way) {
    System *system = build_system(seed, 1);
    Stepper *s = &system->stepper;
    Control *c = build_control(system);
    Course course = {.start = c->time,
                     .distance = system->step * uniform(&system->dice, 0.02, 3.0),
                     .n_points = between(&system->dice, 1, 20),
                     .records = happens(&system->dice, 0.7),
                     .events = (uint32_t)roll(&system->dice)};
    Outcome outcome = {.rows = allocate(MOST_TRIALS * width_of(s), sizeof(double)), .failure = DONE};
    int64_t left = MOST_TRIALS;
    while (left > 0 && course.next < course.n_points) {
        const int32_t room = draw_room(system, way);
        const int64_t most = way == SINGLE_TRIALS ? 1 : way == WHOLE ? left : room < left ? room : left;
        set_point(c, &course);
        c->enough = way == WHOLE ? INFINITY : c->time + uniform(&system->ways, 0.0, 2.0) * system->step;
        const int32_t failure = try_part(system, c, most, course.records ? room : 0, &outcome);
        left -= c->tried;
        if (system->stop != NULL) *system->stop = 0;
        if (!can_go_on(failure)) {
            outcome.failure = failure;
            break;
        }
        meet(system, c, &course);
    }
    outcome.reached = c->accepted;
    outcome.instance = s->instance, outcome.status = s->status, outcome.group = s->group;
    copy_control(&outcome, system, c);
    occurred[TRIALS_ACCEPTED] += c->accepted, occurred[TRIALS_REJECTED] += c->rejected;
    if (outcome.failure != DONE) { /* further steps must not harm memory */
        system->is_lost = 1;
        for (int part = 0; part < 3; part++) {
            c->point = c->time + system->step;
            try_part(system, c, between(&system->ways, 1, 6), between(&system->ways, 0, 3), NULL);
            if (system->stop != NULL) *system->stop = 0;
        }
    }
    free_system(system);
    return outcome;
}

static void free_outcome(Outcome *outcome) {
    free(outcome->rows);
    free(outcome->vectors);
}

static void control_seed(uint64_t seed) {
    Outcome first = control_errors(seed, WHOLE);
    n_failures[first.failure]++;
    for (int way = WHOLE; way <= SINGLE_TRIALS; way++) {
        Outcome again = control_errors(seed, way);
        compare_outcomes(&first, &again);
        free_outcome(&again);
    }
    free_outcome(&first);
}

#endif
