// Divides a node in space: both sides refer to a triangle that crosses the plane.
// M. Stich, H. Friedrich, A. Dietrich, "Spatial Splits in Bounding Volume Hierarchies", HPG 2009.
#pragma once

#include <utility>

#include "scene/bvh_split.h"

namespace veriray::bvh {

inline constexpr int kSpatialBins = 8;

// Boxes of the parts of `r` on either side of a plane; an empty part has lo > hi on some axis. The
// boxes contain the parts: crossings are widened by a bound on their rounding.
inline std::pair<Ref, Ref> chop(const Ref& r, const float* triangle, int axis, float at) {
    Box side[2];
    Float4 v[3];
    for (int k = 0; k < 3; ++k) v[k] = load3(triangle + 3 * k);
    for (int k = 0; k < 3; ++k) {
        const Float4 a = v[k], b = v[k == 2 ? 0 : k + 1];
        const float from = a[axis], to = b[axis];
        if (from <= at) side[0].grow(a, a);
        if (from >= at) side[1].grow(a, a);
        if ((from < at && to > at) || (from > at && to < at)) {
            const Float4 p = a + (b - a) * splat((at - from) / (to - from));
            const Float4 slack = splat(0x1p-21f) * (max4(a, -a) + max4(b, -b));
            side[0].grow(p - slack, p + slack);
            side[1].grow(p - slack, p + slack);
        }
    }
    side[0].hi[axis] = at;
    side[1].lo[axis] = at;
    std::pair<Ref, Ref> out{{max4(r.lo, side[0].lo), min4(r.hi, side[0].hi)},
                            {max4(r.lo, side[1].lo), min4(r.hi, side[1].hi)}};
    out.first.lo[3] = out.second.lo[3] = r.lo[3];
    out.first.hi[3] = out.second.hi[3] = r.hi[3];
    return out;
}

// A lower bound of half the surface of a triangle's box.
inline float filled_half_area(const float* t) {
    const Float4 a{t[3] - t[0], t[4] - t[1], t[5] - t[2], 0.f};
    const Float4 b{t[6] - t[0], t[7] - t[1], t[8] - t[2], 0.f};
    const Float4 n = Float4{a[1], a[2], a[0], 0.f} * Float4{b[2], b[0], b[1], 0.f} -
                     Float4{a[2], a[0], a[1], 0.f} * Float4{b[1], b[2], b[0], 0.f};
    const Float4 m = max4(n, -n);
    return m[0] + m[1] + m[2];
}

inline bool has_points(const Ref& r) {
    return r.lo[0] <= r.hi[0] && r.lo[1] <= r.hi[1] && r.lo[2] <= r.hi[2];
}

struct SpatialSplit {
    float cost = std::numeric_limits<float>::infinity();
    int axis = -1;
    float at = 0;
    Box box[2];
    uint32_t count[2] = {};
};

// Equal slices of a node's box, along one axis after the other.
struct SpatialBins {
    uint32_t enter[3][kSpatialBins] = {}, leave[3][kSpatialBins] = {};
    Float4 origin, width, scale;  // scale 0: the axis is too narrow

    explicit SpatialBins(const Box& b) : origin(b.lo), width(b.hi - b.lo), scale(splat(0.f)) {
        for (int k = 0; k < 3; ++k)
            if (width[k] > 0x1p-100f) scale[k] = static_cast<float>(kSpatialBins) / width[k];
        origin[3] = 0.f;
    }
    Int4 operator()(Float4 p) const {
        const Float4 x = max4((p - origin) * scale, splat(0.f));
        return __builtin_convertvector(min4(x, splat(kSpatialBins - 0.5f)), Int4);
    }
    // First and last bin on each axis.
    std::pair<Int4, Int4> range(const Ref& r) const {
        if (r.divisible()) return {(*this)(r.lo), (*this)(r.hi)};
        const Int4 middle = (*this)(splat(0.5f) * r.centre());
        return {middle, middle};
    }
    void count(const Ref* refs, uint32_t n) {
        for (uint32_t i = 0; i < n; ++i) {
            const auto [first, last] = range(refs[i]);
            for (int k = 0; k < 3; ++k) ++enter[k][first[k]], ++leave[k][last[k]];
        }
    }
    // Calls plane(b, left, right) for the planes between bins b - 1 and b that have references on
    // both sides and divide at most `room` of `n`.
    template <class Plane>
    void planes(int axis, uint32_t n, uint32_t room, Plane plane) const {
        if (scale[axis] == 0.f) return;
        uint32_t left = 0, right = n;
        for (int b = 1; b < kSpatialBins; ++b) {
            left += enter[axis][b - 1];
            right -= leave[axis][b - 1];
            if (left > 0 && right > 0 && left + right - n <= room) plane(b, left, right);
        }
    }
    float plane(int axis, int b) const {
        return origin[axis] + width[axis] * (static_cast<float>(b) * (1.f / kSpatialBins));
    }
};

class Spatial {
   public:
    explicit Spatial(const float* records) : records_(records) {}  // kRecordFloats each

    // The best plane that divides at most `room` references; axis -1 if there is none.
    SpatialSplit find(const Ref* refs, uint32_t n, uint32_t room, const Box& box) const {
        SpatialBins bins(box);
        bins.count(refs, n);
        SpatialSplit best;
        for (int axis = 0; axis < 3; ++axis) {
            int planes = 0;
            bins.planes(axis, n, room, [&](int, uint32_t, uint32_t) { ++planes; });
            if (planes == 0) continue;
            Box part[kSpatialBins], right[kSpatialBins], left;
            for (uint32_t i = 0; i < n; ++i) add_parts(refs[i], axis, bins, part);
            for (int b = kSpatialBins - 1; b > 0; --b) {
                if (b < kSpatialBins - 1) right[b] = right[b + 1];
                right[b].grow(part[b]);
            }
            int next = 0;
            bins.planes(axis, n, room, [&](int b, uint32_t n_left, uint32_t n_right) {
                while (next < b) left.grow(part[next++]);
                const float cost = left.half_area() * static_cast<float>(n_left) +
                                   right[b].half_area() * static_cast<float>(n_right);
                if (cost < best.cost)
                    best = {cost, axis, bins.plane(axis, b), {left, right[b]}, {n_left, n_right}};
            });
        }
        return best;
    }

    // Puts left parts first, with at most `room` more references than before; all may end up on one
    // side.
    Sides partition(Ref* refs, uint32_t& n, uint32_t room, SpatialSplit split) const {
        Sides out{};
        const auto put = [&](int side, const Ref& r) {
            out.box[side].grow(r.lo, r.hi);
            out.centres[side].grow(r.centre(), r.centre());
        };
        uint32_t i = 0, j = n, last = n;
        while (i < j) {
            const Ref r = refs[i];
            int side = r.centre()[split.axis] >= 2 * split.at;
            if (r.divisible() && r.lo[split.axis] < split.at && r.hi[split.axis] > split.at) {
                const auto [left, right] = chop(r, triangle(r), split.axis, split.at);
                side = choose(r, left, right, n + room - last, split);
                if (side == 2) {
                    put(0, refs[i++] = left);
                    put(1, refs[last++] = right);
                    continue;
                }
            }
            put(side, r);
            if (side == 0) {
                ++i;
            } else {
                refs[i] = refs[--j];
                refs[j] = r;
            }
        }
        out.middle = i;
        n = last;
        return out;
    }

   private:
    const float* triangle(const Ref& r) const {
        return records_ + static_cast<size_t>(r.primitive()) * kRecordFloats;
    }

    void add_parts(const Ref& r, int axis, const SpatialBins& bins, Box* part) const {
        const auto [first, last] = bins.range(r);
        Ref rest = r;
        for (int b = first[axis]; b < last[axis]; ++b) {
            const auto [left, right] = chop(rest, triangle(r), axis, bins.plane(axis, b + 1));
            if (has_points(left)) part[b].grow(left.lo, left.hi);
            rest = right;
        }
        if (has_points(rest)) part[last[axis]].grow(rest.lo, rest.hi);
    }

    // 0, 1: the whole reference goes to that side; 2: its parts go to both; whichever costs least.
    int choose(const Ref& r, const Ref& left, const Ref& right, uint32_t room,
               SpatialSplit& s) const {
        if (!has_points(left)) return 1;
        if (!has_points(right)) return 0;
        Box whole[2] = {s.box[0], s.box[1]}, part[2] = {s.box[0], s.box[1]};
        for (Box& b : whole) b.grow(r.lo, r.hi);
        part[0].grow(left.lo, left.hi);
        part[1].grow(right.lo, right.hi);
        const float n0 = static_cast<float>(s.count[0]), n1 = static_cast<float>(s.count[1]);
        const float area0 = part[0].half_area(), area1 = part[1].half_area();
        const float only0 = whole[0].half_area() * n0 + area1 * (n1 - 1);
        const float only1 = area0 * (n0 - 1) + whole[1].half_area() * n1;
        const float both = area0 * n0 + area1 * n1;
        if (room > 0 && both < only0 && both < only1) return 2;
        const int side = only1 < only0;
        s.box[side] = whole[side];
        s.count[1 - side] -= s.count[1 - side] > 1;
        return side;
    }

    const float* records_;
};

}  // namespace veriray::bvh
