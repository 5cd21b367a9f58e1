// The formula of one tetrahedron, of a grid or of a mesh.
//
// With p_c = alpha grad of channel c in a frame of the ground, P the sum of p_c p_c^T and s the stretch of the sharpness, its metric
// over the ground is I + s P. Its volume is V0 sqrt(det(I + s P)), and the gradient of the volume along the frame of channel c is
// V0 adj(I + s P) p_c / sqrt(det(I + s P)), over alpha. det and adj are sums of the principal minors of P.
#pragma once
#include <cmath>

#include "grid_weights.h"

namespace meshflow {

// P becomes V0 adj(I + s P) / sqrt(det(I + s P)); returns the root, the volume of the tetrahedron over V0.
template <class W, class T> INLINE T lifted(T q, T whole, T& xx, T& yy, T& zz, T& yz, T& xz, T& xy) {
    const T trace = xx + yy + zz, s = W::stretch(trace, q);
    const T mx = yy * zz - yz * yz, my = xx * zz - xz * xz, mz = xx * yy - xy * xy;
    const T minors = mx + my + mz, cube = xx * mx - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    const T det = T(1) + s * (trace + s * ((minors > T(0) ? minors : T(0)) + s * (cube > T(0) ? cube : T(0))));
    const T root = std::sqrt(det), by = whole / root;
    const T off_x = by * s * (s * (xy * xz - yz * xx) - yz), off_y = by * s * (s * (xy * yz - xz * yy) - xz);
    const T off_z = by * s * (s * (xz * yz - xy * zz) - xy);
    const T on_x = by * (T(1) + s * ((yy + zz) + s * mx)), on_y = by * (T(1) + s * ((xx + zz) + s * my));
    zz = by * (T(1) + s * ((xx + yy) + s * mz));
    xx = on_x, yy = on_y, yz = off_x, xz = off_y, xy = off_z;
    return root;
}

}  // namespace meshflow
