// Sums as 128-bit fixed point in two's complement: exact, so free of any order.
#pragma once

#include "core/platform.h"

namespace veriray {

struct Fixed128 {
    uint64_t lo, hi;
};

VR_HD void add(Fixed128& a, Fixed128 b) {
    a.lo += b.lo;
    a.hi += b.hi + (a.lo < b.lo ? 1u : 0u);
}

VR_HD Fixed128 negated(Fixed128 a) {
    const uint64_t lo = ~a.lo + 1;
    return {lo, ~a.hi + (lo == 0 ? 1u : 0u)};
}

// round(x * 2^scale), halves up, for 0 <= x < 2^(127 - scale).
VR_HD Fixed128 to_fixed(double x, int scale) {
    const uint64_t b = bit_cast<uint64_t>(x);
    const int exponent = static_cast<int>(b >> 52);
    const uint64_t m = (b & 0xfffffffffffffull) | 0x10000000000000ull;
    const int shift = exponent - 1075 + scale;
    if (shift > 0 && shift < 64) return {m << shift, m >> (64 - shift)};
    if (exponent == 0 || shift < -54) return {0, 0};
    if (shift < 0) return {(m + (1ull << (-shift - 1))) >> -shift, 0};
    if (shift == 0) return {m, 0};
    return {0, m << (shift - 64)};
}

// Nearest double of a * 2^-scale, up to two roundings; exactly odd in a.
VR_HD double to_double(Fixed128 a, int scale) {
    const double unit = bit_cast<double>(static_cast<uint64_t>(1023 - scale) << 52);
    const double two64 = 18446744073709551616.0;
    const bool negative = (a.hi >> 63) != 0;
    const Fixed128 size = negative ? negated(a) : a;
    const double x = (static_cast<double>(size.hi) * two64 + static_cast<double>(size.lo)) * unit;
    return negative ? -x : x;
}

}  // namespace veriray
