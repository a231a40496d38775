/* FMI 2.0 around a system of FMUs; see container.h. Of this folder it is the only file to compile; each part
 * that is compiled in has another one.
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

#include "container.h"

#include "fmi2_functions.h"
