#include "mesh_crossings.h"

MESHFLOW_KERNEL_OF_ONE(crossing_pairs)
MESHFLOW_KERNEL_OF_ONE(folded_pairs)
