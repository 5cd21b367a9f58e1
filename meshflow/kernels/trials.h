// Kernels for tests of the gate and the team: every kind of parameter, every kind of failure.
#pragma once
#include <atomic>

#include "memory.h"
#include "team.h"

namespace meshflow {

struct TrialOptions {
    double factor;
    i32 shift;
    std::uint8_t flag;
    double pair[2];
};

// target = source * factor + shift, both with strided rows; masked samples are left out.
template <class T>
i64 trial_rows(i64 h, i64 w, const T* source, i64 step, T* target, i64 target_step, const u8* mask, double factor, i64 shift) {
    for (i64 r = 0; r < h; ++r)
        for (i64 j = 0; j < w; ++j)
            if (!mask || mask[r * w + j]) target[r * target_step + j] = source[r * step + j] * T(factor) + T(shift);
    return h * w;
}

// target[i] = the sum of the samples with indices index[begin[i]] to index[begin[i + 1] - 1]; overwritten if requested.
template <class T>
i64 trial_gathered(i64 m, i64 k, i64 n, const i64* begin, const i32* index, const T* source, T* target) {
    for (i64 i = 0; i < m; ++i) {
        T sum = 0;
        for (i64 j = begin[i]; j < begin[i + 1]; ++j) sum += source[index[j]];
        target[i] = sum;
    }
    return k + n;
}

template <class T> i64 trial_over(i64 n, const T* source, T* target) {
    for (i64 i = 0; i < n; ++i) target[i] = -source[i];
    return 0;
}

inline i64 trial_options(const TrialOptions* options, i64 count, double* seen) {
    const double all[] = {options->factor, double(options->shift), double(options->flag), options->pair[0], options->pair[1]};
    for (i64 i = 0; i < count; ++i) seen[i] = i < 5 ? all[i] : 0;
    return count;
}

inline i64 trial_failed(i64 code, i64 bytes) {
    if (bytes) {
        const Memory<u8> memory(bytes);
        if (!memory) return NO_MEMORY;
        *static_cast<volatile u8*>(memory.get()) = 1;  // Clang removes allocations that are not used
    }
    return code;
}

// Which thread runs which part; parts wait until the expected number of threads has arrived, or for a limited time.
inline i64 trial_census(i64 parts, i32* who, i32 threads) {
    std::atomic<i32> here{0};
    const i32 wanted = parts < threads ? static_cast<i32>(parts) : threads;
    parallel_for(parts, threads, [&](i64 part, i32 me) {
        who[part] = me;
        here.fetch_add(1);
        for (i64 turn = 0; here.load() < wanted && turn < 3000000000; ++turn) {}
    });
    return team_threads();
}

// The sum of squares, block by block; the two halves of a block are a nested parallel call.
template <class T> i64 trial_sum(i64 n, const T* x, T* sum, i64 block, i32 threads, i32 inner) {
    const i64 parts = (n + block - 1) / block;
    const Memory<T> sums(parts);
    if (!sums) return NO_MEMORY;
    parallel_blocks(n, block, threads, [&](i64 first, i64 last, i64 part, i32) {
        T halves[2] = {};
        parallel_for(2, inner, [&](i64 half, i32) {
            for (i64 i = half ? (first + last) / 2 : first; i < (half ? last : (first + last) / 2); ++i) halves[half] += x[i] * x[i];
        });
        sums[part] = halves[0] + halves[1];
    });
    *sum = 0;
    for (i64 part = 0; part < parts; ++part) *sum += sums[part];
    return parts;
}

// Endless work, until it is stopped.
inline i64 trial_endless(i64 parts, Stop stop, i32 threads) {
    std::atomic<i64> done{0};
    const bool whole = parallel_for(parts, threads, [&](i64, i32) {
        for (int turn = 0; turn < 10000; ++turn) done.fetch_add(1, std::memory_order_relaxed);
    }, stop);
    return whole ? i64(0) : i64(CANCELLED);
}

}  // namespace meshflow
