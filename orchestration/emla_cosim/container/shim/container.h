/* A system of FMUs, the parts, which the stepper of emla_cosim steps: its files are in stepper/.
 *
 * guid.h, sizes.h, system.h and wiring.h are generated for the system. Each part has the functions of FMI 2.0 or 3.0;
 * the host sees FMI 2.0 or 3.0, whose names fmi2_types.h or fmi3_types.h define.
 */
#include "sizes.h"

#include "stepper/step.h"

#define StatusFatal ((Status)fmi2Fatal) /* both versions have the same numbers */

#include "guid.h"

#include "functions.h"

#include "tables.h"

#include "system.h"

#include "instance.h"

#include "wiring.h"

#include "library.h"

#include "parts.h"

#include "part_events.h"

#include "part_values.h"

#include "problems.h"

#include "texts.h"

#include "newton.h"

#include "initialization.h"

#include "lifecycle.h"

#include "communication.h"

#include "values.h"

#include "state.h"
