// Requirements of this library on the machine, and its compiler. This file is compiled for any machine of this architecture,
// because it is called first. MESHFLOW_LEVEL is the level of the x86-64 psABI of all other files, 0 on other architectures.
#include "interface.h"

#if MESHFLOW_LEVEL
#if defined(_MSC_VER) && !defined(__clang__)
#include <immintrin.h>
#include <intrin.h>
#else
#include <cpuid.h>
#endif

namespace {

struct Registers { unsigned a, b, c, d; };

Registers cpuid(unsigned leaf) {
#if defined(_MSC_VER) && !defined(__clang__)
    int r[4] = {};
    __cpuid(r, static_cast<int>(leaf & 0x80000000u));
    if (static_cast<unsigned>(r[0]) < leaf) return {};
    __cpuidex(r, static_cast<int>(leaf), 0);
    return {unsigned(r[0]), unsigned(r[1]), unsigned(r[2]), unsigned(r[3])};
#else
    Registers r{};
    if (!__get_cpuid_count(leaf, 0, &r.a, &r.b, &r.c, &r.d)) return {};
    return r;
#endif
}

// The registers that the system saves when it switches processes: bits 1 and 2 are those of SSE and of AVX.
unsigned kept() {
#if defined(_MSC_VER) && !defined(__clang__)
    return static_cast<unsigned>(_xgetbv(0));
#else
    unsigned low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return low;
#endif
}

char missing[256];

void need(bool there, const char* name) {
    if (there) return;
    char* end = missing;
    while (*end) ++end;
    if (end != missing) *end++ = ' ';
    while (*name) *end++ = *name++;
    *end = 0;
}

}  // namespace

// The features that this machine lacks, such as "avx2 fma"; empty if it has all of them.
MESHFLOW_API const char* machine_missing() {
    const Registers one = cpuid(1), seven = cpuid(7), more = cpuid(0x80000001u);
    const auto bit = [](unsigned where, int which) { return (where >> which & 1) != 0; };
    missing[0] = 0;
    need(bit(one.c, 0), "sse3");
    need(bit(one.c, 9), "ssse3");
    need(bit(one.c, 13), "cx16");
    need(bit(one.c, 19), "sse4.1");
    need(bit(one.c, 20), "sse4.2");
    need(bit(one.c, 23), "popcnt");
#if MESHFLOW_LEVEL >= 3
    need(bit(one.c, 12), "fma");
    need(bit(one.c, 22), "movbe");
    need(bit(one.c, 28), "avx");
    need(bit(one.c, 29), "f16c");
    need(bit(seven.b, 3), "bmi1");
    need(bit(seven.b, 5), "avx2");
    need(bit(seven.b, 8), "bmi2");
    need(bit(more.c, 5), "lzcnt");
    need(bit(one.c, 27) && (kept() & 6) == 6, "avx-registers-kept-by-the-system");
#else
    (void)seven, (void)more, (void)kept;
#endif
    return missing;
}
#else
MESHFLOW_API const char* machine_missing() { return ""; }
#endif

MESHFLOW_API const char* machine_compiler() {
#if defined(__clang__)
    return __VERSION__;
#elif defined(__GNUC__)
    return "GCC " __VERSION__;
#elif defined(_MSC_VER)
    return "MSVC " MESHFLOW_TEXT(_MSC_FULL_VER);
#else
    return "a compiler that does not say its name";
#endif
}
