#include "grid_select.h"

namespace meshflow::grid {

template <> PatchLoops<double> patch_loops_for(double sharpness) {
    return with_weight(sharpness, []<class W>(W) { return patch_loops<double, W>(); });
}
template <> FormLoops<double> form_loops_for(double sharpness) {
    return with_weight(sharpness, []<class W>(W) { return form_loops<double, W>(); });
}

}  // namespace meshflow::grid
