/* FMI 2.0 around a system of FMUs: the parts, which this file steps as the master of emla_cosim does.
 *
 * guid.h, functions.h and system.h are generated for the system. The order of all floating-point operations is
 * that of the master, so that the results have the same bits. Of this folder it is the only file to compile;
 * each part that is compiled in has another one.
 */
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#include "fmi2_types.h"

#include "guid.h"

#include "functions.h"

#include "tables.h"

#include "system.h"

#include "instance.h"

#include "library.h"

#include "parts.h"

#include "exchange.h"

#include "quasi_newton.h"

#include "strong.h"

#include "newton.h"

#include "initialization.h"

#include "lifecycle.h"

#include "values.h"

#include "step.h"

#include "state.h"
