/* FMI 2.0 around the generated equations of one block.
 *
 * guid.h, model.h and generated.h are generated for the block. All values of an instance are one array
 * of doubles, indexed by value reference: inputs, parameters, states, discrete states, outputs,
 * derivatives. This is the only file to compile.
 */
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#include "guid.h"
#include "model.h"

#include "generated.h"

#include "instance.h"

#include "equations.h"

#include "fmi2_common.h"
#include "fmi2_state.h"
#include "fmi2_derivatives.h"
#include "fmi2_co_simulation.h"
#ifdef MODEL_EXCHANGE
#include "fmi2_model_exchange.h"
#endif
