#include "grid_select.h"

namespace meshflow::grid {

template <> PatchLoops<float> patch_loops_for(double sharpness) {
    return with_weight(sharpness, []<class W>(W) { return patch_loops<float, W>(); });
}
template <> FormLoops<float> form_loops_for(double sharpness) {
    return with_weight(sharpness, []<class W>(W) { return form_loops<float, W>(); });
}

}  // namespace meshflow::grid
