// The description of a kernel for Python: a name, the types of its parameters, and an address.
//
// A kernel is a function template over the number type T (float, double) that returns i64: a count or 0, or a Failure.
// `MESHFLOW_KERNEL(name)` below it exports name<float> and name<double> with the types of their parameters, which the Python gate
// compares with its own declaration. `MESHFLOW_KERNEL_OF_ONE(name)` exports a plain function.
//
// The library has no C++ runtime: no exceptions, no `new`, no iostream, no std::vector. <cmath>, <cstdint>, <cstddef>, <atomic>
// and <type_traits> are available. Memory comes from the caller, or from Memory in memory.h.
#pragma once
#include <cstddef>
#include <cstdint>

#if defined(_WIN32)
#define MESHFLOW_API extern "C" __declspec(dllexport)
#else
#define MESHFLOW_API extern "C" __attribute__((visibility("default")))
#endif

#define MESHFLOW_TEXT_(x) #x
#define MESHFLOW_TEXT(x) MESHFLOW_TEXT_(x)

namespace meshflow {

using i32 = std::int32_t;
using i64 = std::int64_t;
using u8 = std::uint8_t;

// The return values of kernels that failed.
enum Failure : i64 { NO_MEMORY = -1, CANCELLED = -2, OUT_OF_RANGE = -3, BAD_SIZES = -4 };

// --- the types of parameters, one letter each, for gate.py ----- -------------------------------------------------------------

template <class A> struct Letter { static constexpr char value = 'x'; };  // a struct
template <> struct Letter<float> { static constexpr char value = 'f'; };
template <> struct Letter<double> { static constexpr char value = 'd'; };
template <> struct Letter<std::int8_t> { static constexpr char value = 'b'; };
template <> struct Letter<std::uint8_t> { static constexpr char value = 'B'; };
template <> struct Letter<std::int16_t> { static constexpr char value = 'h'; };
template <> struct Letter<std::uint16_t> { static constexpr char value = 'H'; };
template <> struct Letter<std::int32_t> { static constexpr char value = 'i'; };
template <> struct Letter<std::uint32_t> { static constexpr char value = 'I'; };
template <> struct Letter<std::int64_t> { static constexpr char value = 'q'; };
template <> struct Letter<std::uint64_t> { static constexpr char value = 'Q'; };

template <class A> struct Passed { static constexpr char how = 'v', what = Letter<A>::value; };
template <class A> struct Passed<A*> { static constexpr char how = 'w', what = Letter<A>::value; };
template <class A> struct Passed<const A*> { static constexpr char how = 'r', what = Letter<A>::value; };

template <class F> struct Signature;
template <class First, class... A> struct Signature<i64 (*)(First, A...)> {
    struct Text { char at[2 * sizeof...(A) + 3]; };
    static constexpr Text made() {
        const char how[] = {Passed<First>::how, Passed<A>::how...}, what[] = {Passed<First>::what, Passed<A>::what...};
        Text text{};
        for (std::size_t i = 0; i < sizeof(how); ++i) text.at[2 * i] = how[i], text.at[2 * i + 1] = what[i];
        return text;
    }
    static constexpr Text text = made();
};

struct Entry {
    const char* signature;  // two letters per parameter: v value, r read or w written; and the type
    void (*address)();
};

template <auto function> Entry entry() {
    return {Signature<decltype(function)>::text.at, reinterpret_cast<void (*)()>(function)};
}

// The layout of a struct that Python fills: its size, then the offset and size of each member, terminated by -1.
struct Layout {
    const char* members;  // "one, two, three"
    const i64* at;
};

}  // namespace meshflow

#define MESHFLOW_KERNEL_OF_ONE(name) \
    MESHFLOW_API meshflow::Entry kernel_##name() { return meshflow::entry<&meshflow::name>(); }
#define MESHFLOW_KERNEL(name)                                                                              \
    MESHFLOW_API meshflow::Entry kernel_##name##_f32() { return meshflow::entry<&meshflow::name<float>>(); } \
    MESHFLOW_API meshflow::Entry kernel_##name##_f64() { return meshflow::entry<&meshflow::name<double>>(); }

// MESHFLOW_LAYOUT(Options, one, two, three): all members of the struct Options, in order.
#define MESHFLOW_LAYOUT(name, ...)                                                                       \
    MESHFLOW_API meshflow::Layout layout_##name() {                                                      \
        using It = meshflow::name;                                                                       \
        static constexpr meshflow::i64 at[] = {sizeof(It), MESHFLOW_EACH(MESHFLOW_MEMBER, __VA_ARGS__) - 1}; \
        return {#__VA_ARGS__, at};                                                                       \
    }
#define MESHFLOW_MEMBER(member) offsetof(It, member), sizeof(It::member),
#define MESHFLOW_AGAIN() MESHFLOW_EACH_STEP
#define MESHFLOW_HELD ()
#define MESHFLOW_EACH_STEP(macro, first, ...) macro(first) __VA_OPT__(MESHFLOW_AGAIN MESHFLOW_HELD(macro, __VA_ARGS__))
#define MESHFLOW_EACH(macro, ...) MESHFLOW_SCAN4(MESHFLOW_EACH_STEP(macro, __VA_ARGS__))
#define MESHFLOW_SCAN1(...) __VA_ARGS__
#define MESHFLOW_SCAN2(...) MESHFLOW_SCAN1(MESHFLOW_SCAN1(MESHFLOW_SCAN1(MESHFLOW_SCAN1(__VA_ARGS__))))
#define MESHFLOW_SCAN3(...) MESHFLOW_SCAN2(MESHFLOW_SCAN2(MESHFLOW_SCAN2(MESHFLOW_SCAN2(__VA_ARGS__))))
#define MESHFLOW_SCAN4(...) MESHFLOW_SCAN3(MESHFLOW_SCAN3(MESHFLOW_SCAN3(MESHFLOW_SCAN3(__VA_ARGS__))))
