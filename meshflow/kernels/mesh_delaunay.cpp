#include "mesh_delaunay.h"

MESHFLOW_KERNEL_OF_ONE(length_angles)
MESHFLOW_KERNEL_OF_ONE(flip_edges)
