/* One block, for both versions of FMI.
 *
 * guid.h, model.h and generated.h are generated for the block. All values of an instance are one array
 * of doubles, indexed by value reference: inputs, parameters, states, discrete states, outputs,
 * derivatives. The elements of an array follow each other.
 */
#include "guid.h"
#include "model.h"

#include "generated.h"

#include "instance.h"

#include "equations.h"

#include "common.h"
#include "state.h"
#include "derivatives.h"
#include "co_simulation.h"
#if defined(MODEL_EXCHANGE) || defined(EXPORTS_ALL_FUNCTIONS)
#include "model_exchange.h"
#endif
