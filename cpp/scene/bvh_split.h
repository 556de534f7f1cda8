// How the builder divides a node's references: binned and swept surface-area heuristic.
// I. Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>

namespace veriray::bvh {

// Four floats of a vector register; a box's fourth float is not a coordinate.
using Float4 = float __attribute__((vector_size(16)));
using Int4 = int32_t __attribute__((vector_size(16)));

inline Float4 splat(float a) { return Float4{a, a, a, a}; }
inline Float4 load3(const float* p, float w = 0.f) { return Float4{p[0], p[1], p[2], w}; }
inline Float4 min4(Float4 a, Float4 b) { return a < b ? a : b; }
inline Float4 max4(Float4 a, Float4 b) { return a > b ? a : b; }

struct Box {
    Float4 lo = splat(std::numeric_limits<float>::infinity());
    Float4 hi = splat(-std::numeric_limits<float>::infinity());
    void grow(Float4 l, Float4 h) { lo = min4(lo, l), hi = max4(hi, h); }
    void grow(const Box& b) { grow(b.lo, b.hi); }
    float half_area() const {
        const Float4 e = hi - lo;
        return e[0] * (e[1] + e[2]) + e[1] * e[2];
    }
};

// A primitive's box, or a part of it. lo[3] holds the primitive as the bits of a normal number;
// hi[3] is 1 if it may be divided in space, else 0.
struct Ref {
    Float4 lo, hi;
    bool divisible() const { return hi[3] == 1.f; }
    Float4 centre() const { return lo + hi; }  // twice the centre
    int32_t weight() const { return 1; }
    uint32_t primitive() const { return std::bit_cast<uint32_t>(float(lo[3])) & 0x07ffffffu; }
    static float primitive_bits(uint32_t p) { return std::bit_cast<float>(p | 0x40000000u); }
};

// The references of one cell of a grid; its centre is its place in the grid.
struct Cell {
    Float4 lo, hi, at;
    uint32_t number;
    int32_t references;
    Float4 centre() const { return at; }
    int32_t weight() const { return references; }
};

inline constexpr uint32_t kMaxBins = 32, kSwept = 8;

// Two sides of a division; the second starts at `middle`.
struct Sides {
    uint32_t middle = 0;
    Box box[2], centres[2];
};

// Equal slices between the least and the largest centre of each axis.
struct Bins {
    uint32_t count;
    Float4 origin, scale;  // of twice the centre

    Bins(const Box& centres, uint32_t bins) : count(bins), origin(centres.lo) {
        scale = splat(0.f);
        for (int k = 0; k < 3; ++k) {
            const float width = centres.hi[k] - centres.lo[k];
            // The largest centre falls short of `count`, however the product is rounded.
            if (width > 0x1p-100f) scale[k] = static_cast<float>(count) * (1.f - 0x1p-20f) / width;
        }
        origin[3] = 0.f;
    }
    static uint32_t enough(uint32_t n) { return std::min(kMaxBins, 4 + n / 8); }
    Int4 operator()(Float4 centre) const {
        return __builtin_convertvector((centre - origin) * scale, Int4);
    }
};

struct Split {
    float cost = std::numeric_limits<float>::infinity();
    int axis = -1;
    uint32_t at = 0;  // the first bin, or sorted reference, of the right side
    Box box[2];
};

// Half the surfaces of three boxes.
inline Float4 half_areas(const Box (&b)[3]) {
    const Float4 e0 = b[0].hi - b[0].lo, e1 = b[1].hi - b[1].lo, e2 = b[2].hi - b[2].lo;
    const Float4 xy{e0[0], e1[0], e0[1], e1[1]}, zw{e0[2], e1[2], e0[3], e1[3]};
    const Float4 x{xy[0], xy[1], e2[0], e2[0]}, y{xy[2], xy[3], e2[1], e2[1]};
    const Float4 z{zw[0], zw[1], e2[2], e2[2]};
    return x * (y + z) + y * z;
}

// The best of 3 (`count` - 1) planes between bins; axis -1 if all centres share one bin. A side
// without references costs infinity times 0, a NaN, which is less than no other cost.
template <class Item>
Split binned_split(const Item* items, uint32_t n, const Bins& bins) {
    Float4 lo[kMaxBins][3], hi[kMaxBins][3];
    Int4 number[kMaxBins];
    std::fill_n(lo[0], 3 * bins.count, Box().lo);
    std::fill_n(hi[0], 3 * bins.count, Box().hi);
    std::fill_n(number, bins.count, Int4{0, 0, 0, 0});
    for (uint32_t i = 0; i < n; ++i) {
        const Int4 b = bins(items[i].centre());
        for (int k = 0; k < 3; ++k) {
            lo[b[k]][k] = min4(lo[b[k]][k], items[i].lo);
            hi[b[k]][k] = max4(hi[b[k]][k], items[i].hi);
            number[b[k]][k] += items[i].weight();
        }
    }
    const auto cost = [&](Box(&acc)[3], Int4& count, uint32_t b) {
        for (int k = 0; k < 3; ++k) acc[k].grow(lo[b][k], hi[b][k]);
        count += number[b];
        return half_areas(acc) * __builtin_convertvector(count, Float4);
    };
    Float4 right[kMaxBins], least = splat(std::numeric_limits<float>::infinity());
    Int4 at{};
    Box from_right[3], from_left[3];
    Int4 on_right{}, on_left{};
    for (uint32_t b = bins.count - 1; b > 0; --b) right[b] = cost(from_right, on_right, b);
    for (uint32_t b = 1; b < bins.count; ++b) {
        const Float4 both = cost(from_left, on_left, b - 1) + right[b];
        const int32_t i = static_cast<int32_t>(b);
        at = both < least ? Int4{i, i, i, i} : at;
        least = both < least ? both : least;
    }
    Split best;
    for (int k = 0; k < 3; ++k)
        if (least[k] < best.cost) best.cost = least[k], best.axis = k, best.at = at[k];
    if (best.axis >= 0)
        for (uint32_t b = 0; b < bins.count; ++b)
            best.box[b >= best.at].grow(lo[b][best.axis], hi[b][best.axis]);
    return best;
}

// Puts the references left of the plane first.
template <class Item>
Sides partition(Item* refs, uint32_t n, const Split& split, const Bins& bins) {
    Sides out{0, {split.box[0], split.box[1]}, {}};
    const int at = static_cast<int>(split.at);
    const float origin = bins.origin[split.axis], scale = bins.scale[split.axis];
    Box left, right;
    for (uint32_t i = 0; i < n; ++i) {
        const Item r = refs[i];
        const Float4 c = r.centre();
        const int32_t off = -(static_cast<int>((c[split.axis] - origin) * scale) >= at);
        // NaN, which comparisons ignore, for the other side.
        const Int4 not_left{off, off, off, off};
        const Float4 l = std::bit_cast<Float4>(std::bit_cast<Int4>(c) | not_left);
        const Float4 h = std::bit_cast<Float4>(std::bit_cast<Int4>(c) | ~not_left);
        left.lo = min4(l, left.lo), left.hi = max4(l, left.hi);
        right.lo = min4(h, right.lo), right.hi = max4(h, right.hi);
        refs[i] = refs[out.middle];
        refs[out.middle] = r;
        out.middle += 1 + off;
    }
    out.centres[0] = left, out.centres[1] = right;
    return out;
}

inline bool before(const Ref& a, const Ref& b, int axis) {
    const float x = a.centre()[axis], y = b.centre()[axis];
    return x < y || (x == y && a.primitive() < b.primitive());
}

// Sorts up to kSwept references along the best axis.
inline Sides swept_split(Ref* refs, uint32_t n) {
    Ref sorted[kSwept], best_order[kSwept];
    Split best;
    for (int k = 0; k < 3; ++k) {
        for (uint32_t i = 0; i < n; ++i) {
            uint32_t j = i;
            for (; j > 0 && before(refs[i], sorted[j - 1], k); --j) sorted[j] = sorted[j - 1];
            sorted[j] = refs[i];
        }
        Box right[kSwept];
        Box acc;
        for (uint32_t i = n - 1; i > 0; --i) acc.grow(sorted[i].lo, sorted[i].hi), right[i] = acc;
        acc = Box();
        bool better = false;
        for (uint32_t i = 1; i < n; ++i) {
            acc.grow(sorted[i - 1].lo, sorted[i - 1].hi);
            const float cost = acc.half_area() * static_cast<float>(i) +
                               right[i].half_area() * static_cast<float>(n - i);
            if (cost < best.cost) {
                best = Split{cost, k, i, {acc, right[i]}};
                better = true;
            }
        }
        if (better) std::copy_n(sorted, n, best_order);
    }
    std::copy_n(best_order, n, refs);
    return {best.at, {best.box[0], best.box[1]}, {}};
}

// Halves by centre along `axis`: for references that no plane separates, and to bound the depth.
inline Sides median_split(Ref* refs, uint32_t n, int axis) {
    Sides out{n / 2, {}, {}};
    std::nth_element(refs, refs + out.middle, refs + n,
                     [axis](const Ref& a, const Ref& b) { return before(a, b, axis); });
    for (uint32_t i = 0; i < n; ++i) {
        const int side = i >= out.middle;
        out.box[side].grow(refs[i].lo, refs[i].hi);
        out.centres[side].grow(refs[i].centre(), refs[i].centre());
    }
    return out;
}

}  // namespace veriray::bvh
