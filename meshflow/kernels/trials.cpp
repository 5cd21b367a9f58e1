#include "trials.h"

MESHFLOW_LAYOUT(TrialOptions, factor, shift, flag, pair)
MESHFLOW_KERNEL(trial_rows)
MESHFLOW_KERNEL(trial_gathered)
MESHFLOW_KERNEL(trial_over)
MESHFLOW_KERNEL(trial_sum)
MESHFLOW_KERNEL_OF_ONE(trial_options)
MESHFLOW_KERNEL_OF_ONE(trial_failed)
MESHFLOW_KERNEL_OF_ONE(trial_census)
MESHFLOW_KERNEL_OF_ONE(trial_endless)
