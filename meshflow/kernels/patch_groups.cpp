#include "patch_groups.h"

MESHFLOW_LAYOUT(GroupOptions, deep, side, stride, reach, members, near, loss, front, top, left, slices, rows, columns)
MESHFLOW_KERNEL(patch_groups)
