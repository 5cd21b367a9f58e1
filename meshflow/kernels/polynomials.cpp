#include "polynomials.h"

MESHFLOW_KERNEL_OF_ONE(chebyshev_degree)
