#include "patch_groups.h"

MESHFLOW_LAYOUT(GroupOptions, deep, side, stride, reach, members, near, loss)
MESHFLOW_KERNEL(patch_groups)
