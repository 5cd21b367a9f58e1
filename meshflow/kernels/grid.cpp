#include "grid.h"

MESHFLOW_LAYOUT(GridOptions, sharpness, gamma, floor, scale, small, across, down, first_sheet, last_sheet, mass, projection, lines,
                gaps, by_forms, evened)
MESHFLOW_LAYOUT(GridBlend, keep, dt, one, two, three)
MESHFLOW_KERNEL(grid_rate)
MESHFLOW_KERNEL(grid_measured)
MESHFLOW_KERNEL(grid_weights)
MESHFLOW_KERNEL_OF_ONE(laid_out)
