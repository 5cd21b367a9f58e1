#include "conjugate_gradients.h"

MESHFLOW_KERNEL_OF_ONE(matrix_product)
MESHFLOW_KERNEL_OF_ONE(conjugate_gradients)
