// Directives for loops over a row. There are no intrinsics: plain loops are compiled to SIMD, each in a function of its own.
#pragma once
#include <bit>

#include "interface.h"

// A loop whose iterations access different samples, so that it can be vectorized without a check of the pointers.
#if defined(__clang__)
#define SIMD _Pragma("clang loop vectorize(assume_safety)")
#define UNROLL _Pragma("unroll")
#elif defined(__GNUC__)
#define SIMD _Pragma("GCC ivdep")
#define UNROLL _Pragma("GCC unroll 16")
#elif defined(_MSC_VER)
#define SIMD __pragma(loop(ivdep))
#define UNROLL
#else
#define SIMD
#define UNROLL
#endif

// INLINE: a formula. LOOP: a loop over a row, compiled once for each template instance.
#if defined(_MSC_VER) && !defined(__clang__)
#define INLINE __forceinline
#define LOOP __declspec(noinline)
#else
#define INLINE inline __attribute__((always_inline))
#define LOOP __attribute__((noinline))
#endif

namespace meshflow::grid {

template <class A> INLINE void exchange(A& a, A& b) {
    A c = a;
    a = b;
    b = c;
}
INLINE i64 least(i64 a, i64 b) { return a < b ? a : b; }
INLINE i64 most(i64 a, i64 b) { return a > b ? a : b; }

// Codes of the same width as the numbers: otherwise the width of the codes would set that of SIMD, and all registers would spill.
template <class T> struct LaneOf { using type = std::int32_t; };
template <> struct LaneOf<double> { using type = std::int64_t; };
template <class T> using Lane = typename LaneOf<T>::type;

// x if a bit of the code is set, else zero. By masks: compilers turn a choice into branches, and several into all combinations.
template <int BIT, class T> INLINE T where(Lane<T> code, T x) {
    return std::bit_cast<T>(std::bit_cast<Lane<T>>(x) & -(code >> BIT & 1));
}
constexpr int UPPER_BIT = 0, LOWER_BIT = 4;

// Sums and maxima of a row in eight parts, which are compiled to SIMD, in a fixed order.
struct Sum {
    double part[8] = {};
    double total() const { return ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7])); }
};
template <class F> INLINE void sum_over(Sum& sum, i64 n, const F& term) {
    i64 i = 0;
    for (; i + 8 <= n; i += 8)
        UNROLL for (int k = 0; k < 8; ++k) sum.part[k] += double(term(i + k));
    for (int k = 0; i < n; ++i, ++k) sum.part[k] += double(term(i));
}
// The maximum of n terms and zero, in 64 interleaved parts that are compiled to SIMD.
template <class F> INLINE double greatest_of(i64 n, const F& term) {
    constexpr i64 APART = 64;
    double most[APART] = {}, found = 0;
    for (i64 i = 0; i < n; i += APART) {
        const i64 some = least(APART, n - i);
        SIMD for (i64 k = 0; k < some; ++k) {
            const double x = double(term(i + k));
            most[k] = x > most[k] ? x : most[k];
        }
    }
    for (double x : most) found = x > found ? x : found;
    return found;
}

}  // namespace meshflow::grid
