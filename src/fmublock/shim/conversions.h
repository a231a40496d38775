/* Values between FMI types and doubles. */

#define AS_IT_IS(x) (x)
#define AS_INTEGER(x) ((fmi2Integer)fmax(INT_MIN, fmin(x, INT_MAX)))
#define AS_BOOLEAN(x) ((x) != 0.0 ? fmi2True : fmi2False)
#define AS_DOUBLE(x) ((double)(x))
#define AS_TRUTH(x) ((x) != fmi2False ? 1.0 : 0.0)
