#include "mesh_tetrahedra.h"

MESHFLOW_KERNEL_OF_ONE(tetrahedra_measured)
MESHFLOW_KERNEL_OF_ONE(tetrahedra_gathered)
