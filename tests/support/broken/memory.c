/* The good FMU, with a fault in how it uses memory or computes; FAULT is one of those below. */
#include <limits.h>

#include "fmi2Functions.h"

#undef fmi2SetReal
#undef fmi2DoStep
#undef fmi2Reset
#undef fmi2FreeInstance
#undef fmi2GetFMUstate
#undef fmi2SerializeFMUstate
#define fmi2SetReal good_set_real
#define fmi2DoStep good_do_step
#define fmi2Reset good_reset
#define fmi2FreeInstance good_free_instance
#define fmi2GetFMUstate good_get_state
#define fmi2SerializeFMUstate toy_serialize
#include "good.c"
#undef fmi2SetReal
#undef fmi2DoStep
#undef fmi2Reset
#undef fmi2FreeInstance
#undef fmi2GetFMUstate
#undef fmi2SerializeFMUstate

enum {
    SOUND,
    HEAP_OVERRUN,
    STACK_OVERRUN,
    STATIC_OVERRUN,
    LONG_READ,
    USE_AFTER_FREE,
    FREED_TWICE,
    NULL_READ,
    BYTES_OVERRUN,
    INSTANCE_LEAK,
    STATE_LEAK,
    STEP_LEAK,
    SIGNED_OVERFLOW,
    MISALIGNED,
    SHIFT
};

static double *values; /* of one instance at a time */
static int table[4];
static volatile int steps;
static void *volatile leaked;

static void put(int *numbers, size_t k, int value) { numbers[k] = value; }
static void keep(size_t k, double value) { values[k] = value; }

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real value[]) {
    double sum = 0.0;
    if (FAULT == HEAP_OVERRUN) {
        values = malloc(n * sizeof *values);
        for (size_t k = 0; k <= n; k++) keep(k, (double)k);
        free(values);
    }
    if (FAULT == LONG_READ)
        for (size_t k = 0; k <= n; k++) sum += value[k];
    if (FAULT == STATIC_OVERRUN) put(table, n + 3, (int)sum);
    return good_set_real(c, r, n, value);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real length, fmi2Boolean noReturn) {
    int local[4] = {0};
    char *bytes = calloc(1, 16);
    steps = 31;
    if (FAULT == STACK_OVERRUN) put(local, steps - 27, 1);
    if (FAULT == NULL_READ) steps = *(volatile int *)(uintptr_t)(steps - 31);
    if (FAULT == SIGNED_OVERFLOW) steps = INT_MAX - 30 + steps;
    if (FAULT == SHIFT) steps = 1 << (steps + 1);
    if (FAULT == MISALIGNED) *(int *)(bytes + 1) = steps;
    if (FAULT == STEP_LEAK) leaked = malloc(24);
    free(bytes);
    return good_do_step(c, time, length, noReturn);
}

fmi2Status fmi2Reset(fmi2Component c) {
    if (FAULT == USE_AFTER_FREE || FAULT == FREED_TWICE) {
        values = calloc(2, sizeof *values);
        free(values);
        if (FAULT == FREED_TWICE) free(values);
        else steps = values[1] > 0.0;
    }
    return good_reset(c);
}

void fmi2FreeInstance(fmi2Component c) {
    if (FAULT == INSTANCE_LEAK) leaked = malloc(100);
    good_free_instance(c);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (FAULT == STATE_LEAK) *state = NULL; /* which makes a new one each time */
    return good_get_state(c, state);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (FAULT == BYTES_OVERRUN) bytes[size] = 0;
    return (fmi2Status)serialize(c, state, bytes, size);
}
