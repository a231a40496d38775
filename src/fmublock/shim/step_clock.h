/* The clock of a component. It counts steps of the same length instead of summing them up, so that a host's rounding
 * of times does not change a bit of the results.
 *
 * The same in FMUs and in the C files that `emla export` writes.
 */

typedef struct {
    double origin, step, count;
} StepClock;

/* Time at which the step of the clock begins. */
static inline double clock_time(const StepClock *clock) { return clock->origin + clock->count * clock->step; }
