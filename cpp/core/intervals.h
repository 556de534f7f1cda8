// Choices among many by tables.
//
// An interval's upper end is an integer, in units of 2^-24; the last of a table is 2^24. A guide
// holds, for 2^bits parts of [0, 1), the interval that each begins in, and last the one that the
// last part ends in.
#pragma once

#include "core/lane.h"

namespace veriray {

// The table of interval ends that begins at ends[base].
template <class L>
struct Intervals {
    using F = typename L::F;
    using U = typename L::U;
    const float* ends;
    U base;

    VR_HD F end(U k) const { return gather(ends, base + k); }
    VR_HD F start(U k) const {
        const auto first = k == U(0u);
        return select(first, F(0.f), end(select(first, k, k + U(~0u))));
    }
    VR_HD F size(U k) const { return end(k) - start(k); }

    // The interval that holds u, and its size. rest: where in it, in the middle of the places that
    // u stands for.
    VR_HD U choose(const uint32_t* guides, U guide, uint32_t bits, F u, F& rest, F& size) const {
        const U part = guide + to_uint(u * F(static_cast<float>(1u << bits)));
        return find(gather(guides, part), gather(guides, part + U(1u)), u * F(0x1p24f), rest, size);
    }
    // The same for u in units of 2^-24, of the intervals from low to high.
    VR_HD U find(U low, U high, F u24, F& rest, F& size) const {
        for (auto open = low < high; any(open); open = low < high) {
            const U middle = (low + high) >> 1;
            const auto above = open & !(u24 < end(middle));
            high = select(open & !above, middle, high);
            low = select(above, middle + U(1u), low);
        }
        const F from = start(low);
        size = end(low) - from;
        rest = (u24 - from + F(0.5f)) / size;
        return low;
    }
    VR_HD U choose(const uint32_t* guides, U guide, uint32_t bits, F u, F& rest) const {
        F size;
        return choose(guides, guide, bits, u, rest, size);
    }
};

// A place in [0, 1] of a density that is linear between the weights a and b at the ends.
template <class F>
VR_HD F linear_place(F a, F b, F u) {
    const F total = a + b, from = a / total, to = b / total;
    const F root = sqrt(fma(u, to * to, (F(1.f) - u) * (from * from)));
    return min(u / (from + root), F(1.f));
}
// From a to b; exactly a where they are equal.
template <class F>
VR_HD F between(F a, F b, F u) {
    return fma(u, b - a, a);
}

}  // namespace veriray
