// The loops whose weight is a constant at compile time, in separate files, by sharpness and number of channels.
#pragma once
#include "grid_forms.h"

namespace meshflow::grid {

template <class T> ChannelLoops<T> channel_loops_for(i64 channels, double sharpness);
template <class T> PatchLoops<T> patch_loops_for(double sharpness);
template <class T> FormLoops<T> form_loops_for(double sharpness);

}  // namespace meshflow::grid
