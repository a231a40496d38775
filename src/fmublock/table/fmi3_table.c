/* FMI 3.0 around data over time in the FMU's resources: one binary for all data.
 *
 * model.h is generated for a number of outputs, at most N_OUTPUTS; all else is that of blocks, see
 * fmi3_block.c. This is the only file to compile.
 */
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <windows.h>
#endif

#include "fmi3Functions.h"

#include "fmi3_types.h"

#include "model.h"

#include "data.h"

#define RESOURCE_HEADER "resource.h"
#include "instance.h"

#include "equations.h"

#include "common.h"
#include "state.h"
#include "derivatives.h"
#include "co_simulation.h"
#include "model_exchange.h"

#include "fmi3_functions.h"
