/* The good FMU, whose step acts on what is outside of it: the time that passes, or its parent process. */
#define _DEFAULT_SOURCE
#include "fmi2Functions.h"
#undef fmi2DoStep
#define fmi2DoStep good_step
#include "good.c"
#undef fmi2DoStep

FMI2_Export fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean noReturn) {
#ifdef KILLS
    if (time > 0.2) kill(getppid(), SIGKILL);
#endif
#ifdef SLEEPS
    usleep(SLEEPS);
#endif
    return good_step(c, time, length, noReturn);
}
