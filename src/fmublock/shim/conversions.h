/* Values between FMI types and doubles. */

#define AS_IT_IS(x) (x)
#define AS_INTEGER(x) ((Integer)fmax(INT_MIN, fmin(x, INT_MAX)))
#define AS_BOOLEAN(x) ((x) != 0.0 ? 1 : 0)
#define AS_DOUBLE(x) ((double)(x))
#define AS_TRUTH(x) ((x) != 0 ? 1.0 : 0.0)
