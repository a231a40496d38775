/* Signals while a stepper runs. Exported FMUs do not have this file.
 *
 * A handler of Python runs only between two instructions of Python, so not before a stepper returns. These
 * functions put a handler before it that sets a flag as well. Call them in the main thread only, which Python's
 * handlers run in.
 */
#define _POSIX_C_SOURCE 200809L

#include <signal.h>
#include <stddef.h>
#include <stdint.h>

#ifndef STEPPER_API
#define STEPPER_API
#endif

STEPPER_API void interrupts_catch(volatile int32_t *flag);
STEPPER_API void interrupts_release(void);

#ifdef _WIN32

void interrupts_catch(volatile int32_t *flag) { (void)flag; }
void interrupts_release(void) {}

#else

enum { N_HANDLED = 3 };
static const int numbers[N_HANDLED] = {SIGINT, SIGTERM, SIGHUP};
static struct sigaction earlier[N_HANDLED];
static int is_caught[N_HANDLED];
static volatile int32_t *raised;

static void note(int number) {
    *raised = 1;
    for (int n = 0; n < N_HANDLED; n++)
        if (numbers[n] == number) earlier[n].sa_handler(number);
}

/* Set the flag on each signal that has a handler, which is called as well. */
void interrupts_catch(volatile int32_t *flag) {
    raised = flag;
    for (int n = 0; n < N_HANDLED; n++) {
        struct sigaction ours;
        is_caught[n] = sigaction(numbers[n], NULL, &earlier[n]) == 0 && !(earlier[n].sa_flags & SA_SIGINFO) &&
                       earlier[n].sa_handler != SIG_DFL && earlier[n].sa_handler != SIG_IGN;
        if (!is_caught[n]) continue;
        ours = earlier[n];
        ours.sa_handler = note;
        is_caught[n] = sigaction(numbers[n], &ours, NULL) == 0;
    }
}

void interrupts_release(void) {
    for (int n = 0; n < N_HANDLED; n++)
        if (is_caught[n]) sigaction(numbers[n], &earlier[n], NULL);
}

#endif
