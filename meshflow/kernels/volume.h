// The interface of the flow of a volume for Python: rate, volume, bound, the weights of an implicit step and their product.
#pragma once
#include "volume_tiles.h"

namespace meshflow::volume {

template <class T>
i64 task_of(Task<T>& t, i64 k, i64 d, i64 h, i64 w, const T* u, const u8* there, const u8* held, const VolumeOptions& o) {
    t.k = k, t.d = d, t.h = h, t.w = w, t.u = u, t.there = there, t.held = held, t.options = o;
    t.ground = Ground<T>::of(o), t.sharpness = T(o.sharpness), t.gamma = T(o.gamma), t.quarters = grid::quarters_of(o.gamma);
    const bool diagonals = o.first_diagonal >= 0 && o.first_diagonal < o.last_diagonal && o.last_diagonal <= 4;
    return k < 1 || k > Sweep<T>::MOST || d < 2 || h < 2 || w < 2 || !diagonals ? i64(BAD_SIZES) : 0;
}

// work(measured, part) for all tiles.
template <class T, class F> i64 over_volume(const Task<T>& t, Asked asked, i32 threads, const F& work) {
    const Loops<T> loops = loops_for<T>(t.options.sharpness);
    const Cut cut = Cut::of(t.k, t.d, t.h, t.w);
    const i64 wide = grid::wide_for(t.w), rows = Sweep<T>::rows(t, cut), size = (rows + 1) * wide + 64;
    const i64 seats = t.k * t.d * t.h * t.w < grid::FEW ? 1 : grid::least(threads, cut.parts());
    Memory<T> memory(seats * size);
    if (!memory) return NO_MEMORY;
    parallel_for(cut.parts(), static_cast<i32>(seats), [&](i64 part, i32 who) {
        T* begin = memory.get() + who * size;
        while (reinterpret_cast<std::uintptr_t>(begin) % 64) ++begin;
        std::memset(begin, 0, static_cast<std::size_t>((rows + 1) * wide) * sizeof(T));
        work(Sweep<T>(t, loops, asked, cut.tile(part), Room<T>{begin, wide}).run(), part);
    });
    return 0;
}

// weight p - dt (sum of edge weights times the other ends) of one row: adds one direction, forth and back.
template <class T> LOOP void add_edges(i64 from, i64 to, T dt, const T* edges, const T* p, T* q) {
    SIMD for (i64 j = from; j < to; ++j) q[j] -= dt * (edges[j] * p[j]);
}

}  // namespace meshflow::volume

namespace meshflow {

// out = keep u + dt rate + ...; the parameters are declared in meshflow/kernels/volume.py.
template <class T>
i64 volume_rate(i64 k, i64 d, i64 h, i64 w, const T* u, const u8* there, const u8* held, const VolumeOptions* options, T* out,
                const T* one, const T* two, const T* three, const GridBlend* blend, i32 threads) {
    using namespace volume;
    Task<T> t{};
    if (const i64 bad = task_of(t, k, d, h, w, u, there, held, *options)) return bad;
    t.out = out, t.a = one, t.b = two, t.c = three;
    t.mix = {T(blend->keep), T(blend->dt), T(blend->one), T(blend->two), T(blend->three)};
    t.terms = two || three ? 2 : one ? 1 : 0;
    return over_volume(t, MOVED, threads, [](const Measured&, i64) {});
}

// found: the volume (asked: 1); the largest s M_flat / M, and of several channels the largest expansion of a tetrahedron (2).
template <class T>
i64 volume_measured(i64 k, i64 d, i64 h, i64 w, const T* u, const u8* there, const u8* held, const VolumeOptions* options, i64 asked,
                    double* found, i32 threads) {
    using namespace volume;
    Task<T> t{};
    if (const i64 bad = task_of(t, k, d, h, w, u, there, held, *options)) return bad;
    if (asked != AREA && asked != BOUND) return BAD_SIZES;
    const Cut cut = Cut::of(k, d, h, w);
    Memory<Measured> parts(cut.parts());
    if (!parts) return NO_MEMORY;
    const i64 done = over_volume(t, static_cast<Asked>(asked), threads, [&](const Measured& m, i64 part) { parts[part] = m; });
    found[0] = found[1] = found[2] = 0;
    for (i64 i = 0; i < cut.parts() && !done; ++i) {
        found[0] += parts[i].area;
        found[1] = parts[i].fastest > found[1] ? parts[i].fastest : found[1];
        found[2] = parts[i].expansion > found[2] ? parts[i].expansion : found[2];
    }
    return done;
}

// The weights of all edges of an implicit step, initially zero, each at its first sample; and s / M.
template <class T>
i64 volume_weights(i64 k, i64 d, i64 h, i64 w, i64 e, const T* u, const u8* there, const u8* held, const VolumeOptions* options,
                   T* edges, T* inverses, i32 threads) {
    using namespace volume;
    Task<T> t{};
    if (const i64 bad = task_of(t, k, d, h, w, u, there, held, *options)) return bad;
    if (e != 13 && !(e == 3 && k == 1)) return BAD_SIZES;
    t.edges = edges, t.directions = e, t.inverses = inverses;
    return over_volume(t, MOVED, threads, [](const Measured&, i64) {});
}

// q = (mass + dt stiffness) p, where weight is the diagonal of the matrix; p . q of each channel.
template <class T>
i64 volume_multiplied(i64 k, i64 d, i64 h, i64 w, i64 e, const T* p, T* q, const T* weight, const T* edges, double dt, double* dots,
                      i32 threads) {
    using namespace volume;
    if (e > 13) return BAD_SIZES;
    const i64 rows = d * h;
    Memory<double> sums(k * rows);
    if (!sums) return NO_MEMORY;
    parallel_blocks(k * rows, grid::most(1, (1 << 16) / w), k * rows * w < grid::FEW ? 1 : threads, [&](i64 first, i64 last, i64, i32) {
        for (i64 part = first; part < last; ++part) {
            const i64 r = part % rows, z = r / h, y = r % h;
            const T* here = p + part * w;
            T* to = q + part * w;
            for (i64 j = 0; j < w; ++j) to[j] = weight[r * w + j] * here[j];
            for (i64 i = 0; i < e; ++i)
                for (int sign = 1; sign > -2; sign -= 2) {
                    const i64 x = sign * DIRECTION[i][0], other_y = y + sign * DIRECTION[i][1], other_z = z + sign * DIRECTION[i][2];
                    if (other_y < 0 || other_y >= h || other_z < 0 || other_z >= d) continue;
                    const i64 by = ((other_z - z) * h + (other_y - y)) * w + x;
                    const T* at = edges + (i * rows + r) * w + (sign < 0 ? by : 0);
                    add_edges(x < 0 ? 1 : 0, x > 0 ? w - 1 : w, T(dt), at, here + by, to);
                }
            grid::Sum sum;
            grid::sum_over(sum, w, [&](i64 j) { return double(here[j]) * double(to[j]); });
            sums[part] = sum.total();
        }
    });
    for (i64 c = 0; c < k; ++c) {
        dots[c] = 0;
        for (i64 r = 0; r < rows; ++r) dots[c] += sums[c * rows + r];
    }
    return 0;
}

}  // namespace meshflow
