#include "grid_select.h"

namespace meshflow::grid {

template <> ChannelLoops<double> channel_loops_for(i64 channels, double sharpness) {
    return with_weight(sharpness, [&]<class W>(W) {
        if (channels == 1) return channel_loops<double, W, 1>();
        return channels == 2 ? channel_loops<double, W, 2>() : channel_loops<double, W, 3>();
    });
}

}  // namespace meshflow::grid
