/* The clock of a component: it counts steps of the same length instead of summing them up, so that its times
 * are exact and the host's rounding of times does not change a bit of the results.
 *
 * FMUs include this file. C files that `emla export` writes contain its text.
 */

typedef struct {
    double origin, step, count;
} Clock;

/* Time at which the step of the clock begins. */
static inline double clock_time(const Clock *clock) { return clock->origin + clock->count * clock->step; }
