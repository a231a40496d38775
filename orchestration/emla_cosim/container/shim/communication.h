/* The communication step: any whole number of steps of the system. */

#define TIME_TOLERANCE 1e-6 /* of times of the host, as a fraction of the step */

/* The number of the system's steps in a step of the host; 0 for one that exists only through rounding, and
   negative if there is none. */
static int64_t count_steps(const Instance *instance, double time, double length) {
    const Memory *memory = &instance->memory;
    const double now = point(&instance->stepper, memory->steps), rounding = 1e-12 * fabs(time);
    if (!(isfinite(time + length) && length > 0.0)) {
        report(instance, StatusError, "the step from t = %g s of %g s is not possible.", time, length);
        return -1;
    }
    if (fabs(time - now) > TIME_TOLERANCE * STEP_SIZE + rounding) {
        report(instance, StatusError, "the step starts at t = %.9g s, but the system is at t = %.9g s.", time, now);
        return -1;
    }
    const double end = time + length;
    if (end > memory->stop_time + TIME_TOLERANCE * STEP_SIZE + rounding) {
        report(instance, StatusError, "the step to t = %.9g s goes past the stop time %.9g s.", end,
               memory->stop_time);
        return -1;
    }
    const double count = rint((end - now) / STEP_SIZE);
    if (count > MAXIMUM_STEPS) {
        report(instance, StatusError, "the step of %g s needs more than %g steps of the system.", length,
               MAXIMUM_STEPS);
        return -1;
    }
    const double there = point(&instance->stepper, memory->steps + (int64_t)count);
    if (fabs(end - there) > TIME_TOLERANCE * STEP_SIZE + rounding) {
        report(instance, StatusError,
               "the step of %.9g s is not a multiple of the system's step of %.9g s; set one in the host.",
               length, STEP_SIZE);
        return -1;
    }
    return (int64_t)count;
}

static Status do_steps(Instance *instance, double time, double length) {
    Memory *memory = &instance->memory;
    Stepper *stepper = &instance->stepper;
    if (require(instance, STEP, "do a step") != StatusOK) return StatusError;
    if (memory->ended) return report(instance, StatusError, "the simulation has ended.");
    const int64_t count = count_steps(instance, time, length);
    if (count < 0) return StatusError;
    for (int64_t n = 0; n < count; n++) {
        if (stepper_step(stepper, memory->steps) == DONE) {
            memory->steps++;
            continue;
        }
        const Status status = blame_failure(instance);
        if (memory->ended) return StatusDiscard;
        if (memory->phase == STEP) { /* some parts have done the step, others have not */
            memory->phase = FAILED;
            return report(instance, StatusError, "the step from t = %.9g s failed; the components are at different times.",
                          point(stepper, memory->steps));
        }
        return status == StatusFatal ? StatusFatal : StatusError;
    }
    report_early_returns(instance);
    return StatusOK;
}

static double reached_time(const Instance *instance) {
    const Memory *memory = &instance->memory;
    if (!(instance->stepper.clock.denominator > 0.0)) return memory->start_time;
    return point(&instance->stepper, memory->steps);
}

static int has_ended(const Instance *instance) { return instance->memory.ended; }
