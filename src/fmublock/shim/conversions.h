/* Values between FMI types and doubles. */

#define AS_IT_IS(x) (x)
#define AS_INTEGER(x) ((Integer)fmax(INT_MIN, fmin(x, INT_MAX)))
#define AS_INT64(x) ((fmi3Int64)fmax(-9007199254740992.0, fmin(x, 9007199254740992.0))) /* 2^53 */
#define AS_BOOLEAN(x) ((x) != 0.0 ? 1 : 0)
#define AS_DOUBLE(x) ((double)(x))
#define AS_TRUTH(x) ((x) != 0 ? 1.0 : 0.0)

/* A type that no variable has: every reference is refused. */
#define NEITHER_GET_NOR_SET(Name, Type)                                                                      \
    Status FMI(Get##Name)(Handle c, const ValueReference vr[], size_t nvr, Type values[] COUNTED(n)) {       \
        return prepare_get(c, vr, nvr, '-', values, COUNT_OF(n, nvr));                                       \
    }                                                                                                        \
    Status FMI(Set##Name)(Handle c, const ValueReference vr[], size_t nvr, const Type values[] COUNTED(n)) { \
        return prepare_set(c, vr, nvr, '-', values, COUNT_OF(n, nvr));                                       \
    }
