// Makes the tables of core/intervals.h.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace veriray {

// Upper ends of intervals in proportion to weights, whose running sums are given: at least one
// unit for what has any. Of no weight at all, zeros. Returns how many have any.
inline uint32_t put_ends(const std::vector<double>& sums, float* ends) {
    const double total = sums.back();
    uint32_t some = 0, before = 0;
    for (size_t k = 0; k < sums.size(); ++k) some += sums[k] > (k ? sums[k - 1] : 0);
    const double per = ((1u << 24) - some) / total;
    for (size_t k = 0; k < sums.size(); ++k) {
        before += sums[k] > (k ? sums[k - 1] : 0);
        const uint32_t end = before < some
                                 ? before + (before ? static_cast<uint32_t>(sums[k] * per) : 0u)
                             : some ? 1u << 24
                                    : 0u;
        ends[k] = static_cast<float>(end);
    }
    return some;
}
// With a guide of 2^bits parts.
inline void put_intervals(const std::vector<double>& sums, float* ends, uint32_t* guide,
                          uint32_t bits) {
    const uint32_t some = put_ends(sums, ends);
    uint32_t k = 0;
    for (uint32_t part = 0; part <= 1u << bits; ++part) {
        const uint32_t first = std::min(part << (24 - bits), (1u << 24) - 1);
        while (some && ends[k] <= static_cast<float>(first)) ++k;
        guide[part] = k;
    }
}

// Of guides for n intervals: one part for 4 of them.
inline uint32_t guide_bits(uint32_t n) {
    uint32_t bits = 0;
    while (n >> (bits + 3)) ++bits;
    return bits;
}

}  // namespace veriray
