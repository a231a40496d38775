/* What the operating system provides: threads and a clock. Exported FMUs do not have this file.
 *
 * The functions are in a translation unit of their own, because Windows' headers define names of stepper.h.
 */
#ifndef SYSTEM_H
#define SYSTEM_H

#include <stdint.h>

typedef struct Thread Thread;

/* Start a thread with the floating-point environment and the locale of this one, which FMUs may have changed.
 * Returns NULL if the system provides no further thread. */
Thread *thread_start(void (*work)(void *), void *argument);

/* Wait until a thread has returned from `work`, and free it. */
void thread_join(Thread *thread);

/* Let other threads run. */
void thread_yield(void);

/* A gate that threads pass while it is open, and sleep at while it is closed. */
typedef struct Gate Gate;

Gate *gate_create(void); /* closed; NULL without memory */
void gate_open(Gate *gate);
void gate_close(Gate *gate);
void gate_pass(Gate *gate);
void gate_free(Gate *gate);

/* Return the time of a monotonic clock in ns. */
int64_t system_clock(void);

#endif
