/* The versions of FMI of the parts: calls whose arguments differ, as a table of functions for each version. Other
 * functions are called directly, by their name of FMI 2.0; both versions have the same numbers of statuses.
 */

/* What a part is told about the simulation; without a stop time, stop is not finite. */
typedef struct {
    double tolerance; /* 0 for the part's own */
    double start, stop;
} Experiment;

typedef struct {
    const char *prefix; /* of the names of functions */
    fmi2Component (*instantiate)(Instance *instance, int part, const char *location);
    fmi2Status (*set_up)(Instance *instance, int part, const Experiment *experiment); /* NULL if enter does it */
    fmi2Status (*enter)(Instance *instance, int part, const Experiment *experiment);
    /* Set or get n variables of a type, which have `count` values. */
    fmi2Status (*set)(Instance *instance, int part, char type, const fmi2ValueReference *references, size_t n,
                      const double *values, size_t count);
    fmi2Status (*get)(Instance *instance, int part, char type, const fmi2ValueReference *references, size_t n,
                      double *values, size_t count);
    fmi2Status (*set_text)(Instance *instance, int part, fmi2ValueReference reference, const char *text);
    fmi2Status (*get_text)(Instance *instance, int part, fmi2ValueReference reference, const char **text);
    /* A step that is not done completely is an error; `ends` is set if the part wants the end. */
    fmi2Status (*step)(Instance *instance, int part, double time, double length, int no_way_back, int *ends);
} Version;

#define CALL(instance, part, name) ((instance)->functions[parts[part].library].name)

#include "part_fmi2.h"

#ifdef HAS_FMI3_PARTS
#include "part_fmi3.h"
#endif

static const Version *version_of(int part) {
#ifdef HAS_FMI3_PARTS
    if (libraries[parts[part].library].fmi == 3) return &version_3;
#endif
    return (void)part, &version_2;
}
