/* The communication step: any whole number of steps of the system. */

/* The end of step k: the next communication point, but not past the stop time, from which it may differ through
   rounding. */
static double end_of_step(const Memory *memory, double k) {
    const double end = point(&memory->clock, k + 1.0), stop = memory->stop_time;
    return point(&memory->clock, k) < stop && stop < end ? stop : end;
}

static Status operate(Instance *instance, const Operation *operation, double k, double time,
                          double length) {
    const int i = operation->part, multiple = parts[i].multiple;
    double begin = time, span = length;
    if (multiple > 1) {
        if (fmod(k + 1.0, multiple) != 0.0) return StatusOK;
        begin = point(&instance->memory.clock, k + 1.0 - multiple);
        span = end_of_step(&instance->memory, k) - begin;
    }
    if (operation->call == SET_INPUTS) return set_inputs(instance, i, begin, span);
    if (operation->call == STEP_PART) return step_part(instance, i, begin, span);
    shift(&instance->memory.now, i, time + length);
    return get_outputs(instance, i);
}

/* Do step k of the system. */
static Status advance(Instance *instance, double k) {
    const double time = point(&instance->memory.clock, k);
    const double length = end_of_step(&instance->memory, k) - time;
    Exchange *now = &instance->memory.now;
    Status status = StatusOK;
    if (N_GROUPS > 0) see(now);
    for (int g = 0; g < N_GROUPS && status == StatusOK; g++)
        status = advance_group(instance, &groups[g], time, length, HALVINGS);
    for (int o = 0; o < N_OPERATIONS && status == StatusOK; o++)
        status = operate(instance, &operations[o], k, time, length);
    if (status != StatusOK) return status;
    const int bad = find_not_finite(now);
    if (bad < 0) return StatusOK;
    return report(instance, StatusError, "%s became %g at t = %.9g s.", signals[bad].name, now->signals[bad],
                  time + length);
}

/* The number of the system's steps in a step of the host; 0 for one that exists only through rounding, and
   negative if there is none. */
static double count_steps(const Instance *instance, double time, double length) {
    const Memory *memory = &instance->memory;
    const double now = point(&memory->clock, memory->steps), rounding = 1e-12 * fabs(time);
    if (!(isfinite(time + length) && length > 0.0)) {
        report(instance, StatusError, "the step from t = %g s of %g s is not possible.", time, length);
        return -1.0;
    }
    if (fabs(time - now) > TIME_TOLERANCE * STEP_SIZE + rounding) {
        report(instance, StatusError, "the step starts at t = %.9g s, but the system is at t = %.9g s.", time, now);
        return -1.0;
    }
    const double end = time + length;
    if (end > memory->stop_time + TIME_TOLERANCE * STEP_SIZE + rounding) {
        report(instance, StatusError, "the step to t = %.9g s goes past the stop time %.9g s.", end,
               memory->stop_time);
        return -1.0;
    }
    const double count = rint((end - now) / STEP_SIZE);
    const double there = point(&memory->clock, memory->steps + count);
    if (fabs(end - there) > TIME_TOLERANCE * STEP_SIZE + rounding) {
        report(instance, StatusError,
               "the step of %.9g s is not a multiple of the system's step of %.9g s; set one in the host.",
               length, STEP_SIZE);
        return -1.0;
    }
    if (count > MAXIMUM_STEPS) {
        report(instance, StatusError, "the step of %g s needs more than %g steps of the system.", length,
               MAXIMUM_STEPS);
        return -1.0;
    }
    return count;
}

static Status do_step(Instance *instance, double time, double length) {
    Memory *memory = &instance->memory;
    if (require(instance, STEP, "do a step") != StatusOK) return StatusError;
    if (memory->ended) return report(instance, StatusError, "the simulation has ended.");
    const double count = count_steps(instance, time, length);
    if (count < 0.0) return StatusError;
    for (double k = 0.0; k < count; k++) {
        const Status status = advance(instance, memory->steps);
        if (status == StatusOK) {
            memory->steps += 1.0;
            continue;
        }
        if (memory->ended) return StatusDiscard;
        if (memory->phase == STEP) { /* some parts have done the step, others have not */
            memory->phase = FAILED;
            return report(instance, StatusError, "the step from t = %.9g s failed, and the parts are apart.",
                          point(&memory->clock, memory->steps));
        }
        return status == StatusFatal ? StatusFatal : StatusError;
    }
    return StatusOK;
}

static double reached_time(const Instance *instance) {
    const Memory *memory = &instance->memory;
    if (!(memory->clock.denominator > 0.0)) return memory->start_time;
    return fmin(point(&memory->clock, memory->steps), memory->stop_time);
}

static int has_ended(const Instance *instance) { return instance->memory.ended; }
