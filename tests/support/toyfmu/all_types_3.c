/* An FMI 3.0 FMU with all types, arrays, states, and steps that end the run, are discarded or return early.

   References: 0 time, 1 u[2,2], 2 y[2,2] = gain * u, 3 gain[2,2], 4 x (integral of u[1,1]), 5 end, 6 fault,
   7 n (structural), 8 what a step adds to the Int64, 10 + 2 t the input of type t, 11 + 2 t the output: the same value,
   40 text, 42 and 43 the String as input and output; 44 and 45 the Binary as input and output,
   46 a Binary of 0 to 3 bytes, or of 9 from the time `end` on, 47 a checksum of the input. */
#define FMI 3
#define HAS_BINARY
#include "toyfmu.h"

enum { DISCARD = 1, TERMINATE, EARLY, STEP_EVENT }; /* fault */

struct Model {
    COMMON;
    double u[4], y[4], gain[4], x, end;
    int32_t fault, checksum;
    float float32;
    int8_t int8;
    uint8_t uint8;
    int16_t int16;
    uint16_t uint16;
    int32_t int32;
    uint32_t uint32;
    int64_t int64, choice, stride;
    uint64_t uint64;
    bool boolean;
    char text[64], passed[64];
    uint8_t bytes[8];
    size_t size;
};

#define PAIR(reference, type, member) \
    VARIABLE(reference, type, member, ANY_MODE), VARIABLE(reference + 1, type, member, ANY_MODE)
static const Variable variables[] = {
    VARIABLE(0, FLOAT64, time, ANY_MODE), VARIABLE(1, FLOAT64, u, ANY_MODE), VARIABLE(2, FLOAT64, y, OUTPUT),
    VARIABLE(3, FLOAT64, gain, ANY_MODE), VARIABLE(4, FLOAT64, x, ANY_MODE), VARIABLE(5, FLOAT64, end, ANY_MODE),
    VARIABLE(6, INT32, fault, ANY_MODE), VARIABLE(8, INT64, stride, ANY_MODE), PAIR(10, FLOAT32, float32),
    PAIR(12, INT8, int8), PAIR(14, UINT8, uint8), PAIR(16, INT16, int16), PAIR(18, UINT16, uint16),
    PAIR(20, INT32, int32), PAIR(22, UINT32, uint32), PAIR(24, INT64, int64), PAIR(26, UINT64, uint64),
    PAIR(28, BOOLEAN, boolean), PAIR(30, INT64, choice), VARIABLE(40, STRING, text, ANY_MODE),
    PAIR(42, STRING, passed), VARIABLE(47, INT32, checksum, ANY_MODE),
};

static int accepts(const Common *instance) { return !instance->events && !instance->early; }

static void start(Model *m) {
    m->choice = 1;
    for (int k = 0; k < 4; k++) {
        m->gain[k] = k + 1.0;
        m->u[k] = 0.5;
    }
}

static int enter_configuration(Model *m) { return ERROR; } /* n cannot be changed */

static void compute(Model *m) {
    for (int k = 0; k < 4; k++) m->y[k] = m->gain[k] * m->u[k];
}

static int step(Model *m, double t, double h, Step *s) {
    const int fault = t + h > m->end ? m->fault : 0;
    if (fault == DISCARD) return DISCARDED;
    s->event = fault == STEP_EVENT;
    s->terminate = fault == TERMINATE;
    s->early = fault == EARLY;
    if (s->early) s->last = t;
    m->x += (s->last - t) * m->u[0];
    m->time = s->last;
    m->int64 += m->stride;
    return OK;
}

EXPORT fmi3Status fmi3GetBinary(fmi3Instance i, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary v[],
                                size_t nv) {
    static fmi3Byte source[9]; /* which the next call changes */
    ENTER(ANY_MODE);
    const int count = (int)(8.0 * m->time + 0.5);
    for (size_t k = 0; k < 9; k++) source[k] = (fmi3Byte)(k == 1 ? 0 : 250 + count);
    for (size_t k = 0; k < nv; k++) {
        sizes[k] = r[k] != 46 ? m->size : m->end > 0.0 && m->time >= m->end ? 9 : (size_t)count % 4;
        v[k] = r[k] != 46 ? m->bytes : sizes[k] ? source : NULL;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetBinary(fmi3Instance i, const fmi3ValueReference r[], size_t n, const size_t sizes[],
                                const fmi3Binary v[], size_t nv) {
    ENTER(ANY_MODE);
    if (r[0] != 44 || sizes[0] > sizeof m->bytes) return fmi3Error;
    m->size = sizes[0];
    memcpy(m->bytes, v[0], sizes[0]);
    m->checksum = 1000 * (int32_t)m->size;
    for (size_t k = 0; k < m->size; k++) m->checksum += (int32_t)(k + 1) * m->bytes[k];
    return fmi3OK;
}

static const Toy toy = {
    MODEL(variables), .null_strings = 42, .accepts = accepts, .start = start,
    .enter_configuration = enter_configuration, .compute = compute, .step = step,
};
