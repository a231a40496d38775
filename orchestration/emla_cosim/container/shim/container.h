/* A system of FMUs, the parts, which this code steps as the master of emla_cosim does.
 *
 * guid.h, functions.h and system.h are generated for the system. The order of all floating-point operations is
 * that of the master, so that the results have the same bits. Each part has the functions of FMI 2.0 or 3.0; the
 * host sees FMI 2.0 or 3.0, whose names fmi2_types.h or fmi3_types.h define.
 */
#include "fmi2FunctionTypes.h"

#define StatusFatal ((Status)fmi2Fatal) /* both versions have the same numbers */

#include "guid.h"

#include "functions.h"

#include "part_types.h"

#include "tables.h"

#include "system.h"

#include "instance.h"

#include "library.h"

#include "part_versions.h"

#include "parts.h"

#include "exchange.h"

#include "quasi_newton.h"

#include "strong.h"

#include "newton.h"

#include "initialization.h"

#include "lifecycle.h"

#include "step.h"

#include "values.h"

#include "state.h"
