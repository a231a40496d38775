/* The clock of `Effort`, and what it costs. Exported FMUs do not have this file. */
#include "system.h"

STEPPER_API int64_t effort_clock(void);
STEPPER_API int64_t effort_cost(Effort *effort, int64_t count);

int64_t effort_clock(void) { return system_clock(); }

/* Measure calls that do nothing, as steps; returns the ns that all of it took. */
int64_t effort_cost(Effort *effort, int64_t count) {
    const int64_t start = system_clock();
    for (int64_t n = 0; n < count; n++) stop_clock(effort, STEP_CALLS, start_clock(effort));
    return system_clock() - start;
}
