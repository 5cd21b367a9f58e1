#include "mesh_connectivity.h"

MESHFLOW_KERNEL_OF_ONE(corners_around)
MESHFLOW_KERNEL_OF_ONE(mark_border)
MESHFLOW_KERNEL_OF_ONE(pattern_rows)
MESHFLOW_KERNEL_OF_ONE(pattern_entries)
