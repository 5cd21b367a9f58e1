#include "volume.h"

MESHFLOW_LAYOUT(VolumeOptions, sharpness, gamma, scale, x, y, z, first_diagonal, last_diagonal, ring, by_forms)
MESHFLOW_KERNEL(volume_rate)
MESHFLOW_KERNEL(volume_measured)
MESHFLOW_KERNEL(volume_weights)
MESHFLOW_KERNEL(volume_multiplied)
