// Sums in 128-bit fixed point, two's complement: exact, so independent of order.
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

// round(m * 2^shift), halves up, for m < 2^48 and shift < 80.
VR_HD Fixed128 to_fixed(uint64_t m, int shift) {
    if (shift >= 64) return {0, m << (shift - 64)};
    if (shift > 0) return {m << shift, m >> (64 - shift)};
    if (shift < -48) return {0, 0};
    return {(m + ((1ull << -shift) >> 1)) >> -shift, 0};
}

// a^2 2^-shift, rounded down, of the 64 leading bits of |a|, for |a| < 2^97 and shift = 68: exact
// where |a| has no more bits.
VR_HD Fixed128 squared(Fixed128 a) {
    if (a.hi >> 63) a = negated(a);
    const int over = a.hi ? 64 - leading_zeros(a.hi) : 0;
    const uint64_t m = over ? a.hi << (64 - over) | a.lo >> over : a.lo;
    const uint64_t lo = m * m, hi = upper_product(m, m);
    const int shift = 68 - 2 * over;  // 2 to 68
    if (shift >= 64) return {hi >> (shift - 64), 0};
    return {lo >> shift | hi << (64 - shift), hi >> shift};
}

// a / by, rounded down, for 0 < by < 2^32.
VR_HD Fixed128 divided(Fixed128 a, uint32_t by) {
    uint64_t rest = 0;
    const auto next = [&](uint64_t word) {
        const uint64_t high = rest << 32 | word >> 32, middle = high % by << 32 | (word & ~0u);
        rest = middle % by;
        return high / by << 32 | middle / by;
    };
    const uint64_t hi = next(a.hi);
    return {next(a.lo), hi};
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
