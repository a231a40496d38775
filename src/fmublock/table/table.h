/* Data over time in the FMU's resources, for both versions of FMI: one binary for all data.
 *
 * model.h is generated for a number of outputs, at most N_OUTPUTS; all else is that of blocks, see block.h.
 */
#include "model.h"

#include "data.h"

#define RESOURCE_HEADER "resource.h"
#include "instance.h"

#include "equations.h"

#include "common.h"
#include "state.h"
#include "derivatives.h"
#include "co_simulation.h"
#ifdef EXPORTS_ALL_FUNCTIONS
#include "model_exchange.h"
#endif
