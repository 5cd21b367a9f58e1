// W^q of a triangle, and the stretch factor of its lengths. For some values of q square roots and products are sufficient.
#pragma once
#include <bit>
#include <cmath>

#include "grid_loops.h"

namespace meshflow::grid {

// --- powers that a loop over a row compiles to SIMD, whatever the exponent ------------------------------------------------------

// ln x of a positive x, to the last digit of double precision (the polynomial of fdlibm, without its branches).
INLINE double logarithm(double x) {
    constexpr std::uint64_t half_root = 0x3fe6a09e667f3bcdu, mantissa = 0x000fffffffffffffu;  // sqrt(1/2)
    const std::uint64_t moved = std::bit_cast<std::uint64_t>(x) + (0x3ff0000000000000u - half_root);
    const double k = std::bit_cast<double>((moved >> 52) | 0x4330000000000000u) - (4503599627370496.0 + 1023.0);
    const double f = std::bit_cast<double>((moved & mantissa) + half_root) - 1.0;
    const double s = f / (2.0 + f), z = s * s, w = z * z, square = 0.5 * f * f;
    const double even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01));
    const double odd = z * (6.666666666666735130e-01 +
                            w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01)));
    return k * 6.93147180369123816490e-01 -
           ((square - (s * (square + (odd + even)) + k * 1.90821492927058770002e-10)) - f);
}

// e^t - 1, with One e^t; outside of the range of double precision its largest or smallest number.
template <bool One> INLINE double exponential(double t) {
    constexpr double shift = 6755399441055744.0;  // 1.5 * 2^52: a number added to it is rounded to an integer
    t = t > 709.0 ? 709.0 : t < -708.0 ? -708.0 : t;
    const double moved = t * 1.44269504088896338700 + shift, k = moved - shift;
    const double r = (t - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10;
    double p = 1.0 / 6227020800.0;
    p = p * r + 1.0 / 479001600.0;
    p = p * r + 1.0 / 39916800.0;
    p = p * r + 1.0 / 3628800.0;
    p = p * r + 1.0 / 362880.0;
    p = p * r + 1.0 / 40320.0;
    p = p * r + 1.0 / 5040.0;
    p = p * r + 1.0 / 720.0;
    p = p * r + 1.0 / 120.0;
    p = p * r + 1.0 / 24.0;
    p = p * r + 1.0 / 6.0;
    p = p * r + 0.5;
    p = r + (r * r) * p;
    const double scale = std::bit_cast<double>((std::bit_cast<std::uint64_t>(moved) + 1023u) << 52);
    return One ? scale + scale * p : scale * p + (scale - 1.0);
}

// x^exponent for x >= 0.
INLINE double raised(double x, double exponent) {
    const double beside = exponent > 0.0 ? 0.0 : exponent < 0.0 ? HUGE_VAL : 1.0;
    const double power = exponential<true>(exponent * logarithm(x));
    return x > 0.0 ? power : x == 0.0 ? beside : x;
}

// x^exponent for x >= 0. Quarters is four times the exponent if roots and products are sufficient, else ANY.
constexpr int ANY = 99;
template <int Quarters, class T> INLINE T power(T x, [[maybe_unused]] T exponent) {
    if constexpr (Quarters == 0) return T(1);
    else if constexpr (Quarters == 2) return std::sqrt(x);
    else if constexpr (Quarters == 3) return std::sqrt(x) * std::sqrt(std::sqrt(x));
    else if constexpr (Quarters == 4) return x;
    else if constexpr (Quarters == 6) return x * std::sqrt(x);
    else if constexpr (Quarters == 8) return x * x;
    else if constexpr (Quarters == -2) return T(1) / std::sqrt(x);
    else if constexpr (Quarters == -4) return T(1) / x;
    else if constexpr (Quarters == -8) return T(1) / (x * x);
    else return static_cast<T>(raised(double(x), double(exponent)));
}

// --- the weight of a sharpness q = Twice / 2; 0: any ------------------------------------------------------------------------

template <int Twice> struct Weight {
    // W^q from W^2.
    template <class T> static INLINE T expansion(T w2, T q) { return power<Twice ? Twice : ANY>(w2, T(0.5) * q); }

    // (W^2q - 1) / (W^2 - 1), W^2 = 1 + slope2: with the free part of the squared lengths times this, the area is W^q.
    template <class T> static INLINE T stretch(T slope2, [[maybe_unused]] T q) {
        if constexpr (Twice == 2) return T(1);
        else if constexpr (Twice == 3) {
            const T w = std::sqrt(T(1) + slope2);
            return w + T(1) / (w + T(1));
        } else if constexpr (Twice == 4) return T(2) + slope2;
        else if constexpr (Twice == 6) return T(3) + slope2 * (T(3) + slope2);
        else if constexpr (Twice == 8) return (T(2) + slope2) * (T(2) + slope2 * (T(2) + slope2));
        else {
            const double s = double(slope2), w2 = 1.0 + s;
            const double grown = exponential<false>(double(q) * (logarithm(w2) + (s - (w2 - 1.0)) / w2));
            return slope2 > T(0) ? static_cast<T>(grown / s) : q;
        }
    }
};

// Calls work(Weight) with the weight of q, so that the sharpness is a constant at compile time.
template <class F> auto with_weight(double q, const F& work) {
    if (q == 1.0) return work(Weight<2>{});
    if (q == 1.5) return work(Weight<3>{});
    if (q == 2.0) return work(Weight<4>{});
    if (q == 3.0) return work(Weight<6>{});
    if (q == 4.0) return work(Weight<8>{});
    return work(Weight<0>{});
}

}  // namespace meshflow::grid
