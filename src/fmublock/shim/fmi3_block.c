/* FMI 3.0 around the generated equations of one block; see block.h. This is the only file to compile. */
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#include "fmi3_types.h"

#include "block.h"

#include "fmi3_functions.h"
