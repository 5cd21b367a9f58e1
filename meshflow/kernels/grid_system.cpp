#include "grid_system.h"

MESHFLOW_KERNEL(grid_multiplied)
MESHFLOW_KERNEL(grid_descended)
MESHFLOW_KERNEL(grid_turned)
MESHFLOW_KERNEL(grid_size)
