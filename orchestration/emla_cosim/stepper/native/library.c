/* The stepper as a library for Python. */
#ifdef _WIN32
#define STEPPER_API __declspec(dllexport)
#else
#define STEPPER_API __attribute__((visibility("default")))
#endif

#include "interrupts.c"

#include "rows.c"

#include "stepper.c"

#include "lanes.c"

#include "effort.c"
