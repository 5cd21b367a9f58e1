#include "mesh_blocks.h"

MESHFLOW_KERNEL_OF_ONE(count_blocks)
MESHFLOW_KERNEL_OF_ONE(number_blocks)
MESHFLOW_KERNEL_OF_ONE(march_blocks)
