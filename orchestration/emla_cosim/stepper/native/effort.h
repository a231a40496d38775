/* What the calls of an instance take, if anybody wants to know. */

ALWAYS_INLINE static int64_t start_clock(const Effort *effort) {
    return STEPPER_WATCHED && effort != NULL ? effort->now() : 0;
}

/* Add a call that began at `start` and ends now. */
ALWAYS_INLINE static void stop_clock(Effort *effort, int32_t kind, int64_t start) {
    if (!STEPPER_WATCHED || effort == NULL) return;
    effort->nanoseconds[kind] += effort->now() - start;
    effort->counts[kind]++;
}
