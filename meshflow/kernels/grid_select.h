// The loops that know their weight when they are compiled, each in a file of its own, by sharpness and channels.
#pragma once
#include "grid_forms.h"

namespace meshflow::grid {

template <class T> ChannelLoops<T> channel_loops_for(i64 channels, double sharpness);
template <class T> PatchLoops<T> patch_loops_for(double sharpness);
template <class T> FormLoops<T> form_loops_for(double sharpness);

}  // namespace meshflow::grid
