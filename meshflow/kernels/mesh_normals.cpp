#include "mesh_normals.h"

MESHFLOW_KERNEL_OF_ONE(triangle_normals)
MESHFLOW_KERNEL_OF_ONE(edge_conductances)
MESHFLOW_KERNEL_OF_ONE(spread_normals)
MESHFLOW_KERNEL_OF_ONE(follow_normals)
