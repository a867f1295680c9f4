// The best build of the core that this processor runs.
#pragma once

#if defined(__x86_64__)
#include <cpuid.h>
#endif

namespace vbaa {

#if defined(__x86_64__)
// What the operating system saves when it switches threads (bits of XCR0).
inline unsigned saved_registers() {
    unsigned low, high;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return low;
}

// Read from the processor itself: Clang's __builtin_cpu_supports needs a library that zig does not link.
inline const char* level() {
    unsigned a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d)) return "base";
    const bool saves = c & bit_OSXSAVE;
    const bool v2_to_v3 = (c & bit_AVX) && (c & bit_FMA) && (c & bit_MOVBE) && (c & bit_F16C);
    if (!saves || !v2_to_v3 || (saved_registers() & 0x6U) != 0x6U) return "base";
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return "base";
    const unsigned features = b;
    unsigned extended = 0;
    if (!__get_cpuid(0x80000001, &a, &b, &extended, &d)) return "base";
    const bool v3 = (features & bit_AVX2) && (features & bit_BMI) && (features & bit_BMI2) && (extended & bit_LZCNT);
    if (!v3) return "base";
    const unsigned v4 = bit_AVX512F | bit_AVX512DQ | bit_AVX512CD | bit_AVX512BW | bit_AVX512VL;
    return (features & v4) == v4 && (saved_registers() & 0xe6U) == 0xe6U ? "v4" : "v3";
}
#else
inline const char* level() { return "base"; }
#endif

}  // namespace vbaa
