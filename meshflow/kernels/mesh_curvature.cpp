#include "mesh_curvature.h"

MESHFLOW_KERNEL_OF_ONE(directed_weights)
