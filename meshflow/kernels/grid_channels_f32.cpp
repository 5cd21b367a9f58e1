#include "grid_select.h"

namespace meshflow::grid {

template <> ChannelLoops<float> channel_loops_for(i64 channels, double sharpness) {
    return with_weight(sharpness, [&]<class W>(W) {
        if (channels == 1) return channel_loops<float, W, 1>();
        return channels == 2 ? channel_loops<float, W, 2>() : channel_loops<float, W, 3>();
    });
}

}  // namespace meshflow::grid
