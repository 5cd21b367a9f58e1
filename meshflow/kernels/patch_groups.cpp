#include "patch_groups.h"

MESHFLOW_LAYOUT(GroupOptions, side, stride, reach, members, near, loss)
MESHFLOW_KERNEL(patch_groups)
