/* The types of values of the parts, as letters. FMI 2.0 has R (Real), I (Integer and enumerations), B (Boolean)
 * and S (String) of them.
 *
 * WHOLE_TYPES applies a macro to each type of whole numbers: its letter, its name in FMI 3.0, its smallest value,
 * and the one after its largest. Enumerations of FMI 3.0 are of type E.
 */
#define WHOLE_TYPES(X)                                             \
    X('b', Int8, -128.0, 128.0)                                    \
    X('c', UInt8, 0.0, 256.0)                                      \
    X('s', Int16, -32768.0, 32768.0)                               \
    X('t', UInt16, 0.0, 65536.0)                                   \
    X('I', Int32, -2147483648.0, 2147483648.0)                     \
    X('u', UInt32, 0.0, 4294967296.0)                              \
    X('E', Int64, -9223372036854775808.0, 9223372036854775808.0)   \
    X('U', UInt64, 0.0, 18446744073709551616.0)

/* The other types of numbers but Float64, which needs no conversion. */
#define OTHER_TYPES(X)                         \
    X('r', Float32, -HUGE_VAL, HUGE_VAL)       \
    X('B', Boolean, 0.0, 2.0)

#define LARGEST_EXACT 9007199254740992.0 /* above 2^53, doubles leave out whole numbers */

/* Whether a type of whole numbers has this value; any other type has all of them. */
static int fits(char type, double value) {
#define IN_RANGE(letter, Name, lowest, limit) \
    case letter: return value >= (lowest) && value < (limit);
    switch (type) {
        WHOLE_TYPES(IN_RANGE)
        default: return 1;
    }
#undef IN_RANGE
}

/* The same for a value from or to the host, of which no digit may be lost. */
static int fits_exactly(char type, double value) {
    const int is_wide = type == 'E' || type == 'U';
    return fits(type, value) && (!is_wide || fabs(value) < LARGEST_EXACT);
}

static const char *type_name(char type) {
#define NAME(letter, Name, lowest, limit) \
    case letter: return #Name;
    if (type == 'S') return "String";
    if (type == 'R' || type == 'I' || type == 'E' || type == 'B') return TYPE_NAME(type);
    switch (type) {
        WHOLE_TYPES(NAME)
        default: return "Float32";
    }
#undef NAME
}
