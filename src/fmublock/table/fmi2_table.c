/* FMI 2.0 around data over time; see table.h. This is the only file to compile. */
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

#include "fmi2Functions.h"

#include "fmi2_types.h"

#include "table.h"

#include "fmi2_functions.h"
