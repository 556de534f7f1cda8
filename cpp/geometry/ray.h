#pragma once

#include "core/math.h"
#include "core/vec.h"

namespace veriray {

// d has unit length to within rounding.
template <class L>
struct Ray {
    Vec3<typename L::F> o, d;

    VR_HD Vec3<typename L::F> at(typename L::F t) const { return fma(d, t, o); }
};

// Closest hit so far. At equal distances the primitive with the smaller number wins, whatever the
// order of tests.
template <class L>
struct Hit {
    typename L::F t;  // infinity: none
    typename L::U primitive;
};

// The hits of a ray are ordered by (t, primitive). A ray that passes a surface continues in that
// order, so nothing that coincides with the surface is met twice or left out.
// The last hit of a ray that has met nothing yet: its hits have t > 0.
template <class L>
VR_HD Hit<L> nothing_met() {
    return {typename L::F(0.f), typename L::U(~0u)};
}
// Whether a hit of `primitive` at t lies beyond `last`.
template <class L>
VR_HD typename L::M beyond(const Hit<L>& last, typename L::F t, typename L::U primitive) {
    return (t > last.t) | ((t == last.t) & (last.primitive < primitive));
}

// inside & 0 < t < t_max; false for a NaN.
template <class L>
VR_HD typename L::M between(typename L::M inside, typename L::F t, typename L::F t_max) {
    return and_less(and_less(inside, typename L::F(0.f), t), t, t_max);
}

// n.p + w of a plane or edge function {n, w}, uniform over lanes.
template <class L, class Record>
VR_HD typename L::F height_over(const Record* plane, Vec3<typename L::F> p) {
    using F = typename L::F;
    return fma(F(plane[2]), p.z, fma(F(plane[1]), p.y, fma(F(plane[0]), p.x, F(plane[3]))));
}

// Distance along the ray to the plane n.p + w = 0; meaningless (infinite, NaN or beyond the scene)
// for a ray within the plane.
template <class L, class Record>
VR_HD typename L::F plane_distance(const Record* plane, const Ray<L>& ray) {
    return plain_quotient(-height_over<L>(plane, ray.o),
                          dot(broadcast<typename L::F>(plane), ray.d));
}

// Of n.p: what its rounding is in proportion to.
template <class F>
VR_HD F terms(Vec3<F> n, Vec3<F> p) {
    return fma(abs(n.z), abs(p.z), fma(abs(n.y), abs(p.y), abs(n.x) * abs(p.x)));
}

// A rounded point put back on its plane, the point off the plane, and the latter's height are each
// off by at most 2 units of 2^-24 of the terms |n_k p_k|; this is 8. The terms before the point is
// put back are larger by at most the distance that this moves it. That counts close to the origin:
// where the terms are less than kLocalMove times that distance, this takes their place. They count
// as kLocalTerms at least: at a point of no height beside a normal's rounded 0 they underflow.
inline constexpr float kLocalOffset = 0x1p-21f, kLocalMove = 3, kLocalTerms = 0x1p-40f;

// The bound for a point on a plane, which was put back onto it by `off`.
template <class F>
VR_HD F local_offset(Vec3<F> n, Vec3<F> p, F off) {
    const F least = max(abs(off) * F(kLocalMove), F(kLocalTerms));
    return max(terms(n, p), least) * F(kLocalOffset);
}

}  // namespace veriray
