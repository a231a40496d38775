/* FMI 3.0 around a system of FMUs; see container.h. Of this folder it is the only file to compile; each part
 * that is compiled in has another one.
 */
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#include "fmi3_types.h"

#include "container.h"

#include "fmi3_functions.h"
