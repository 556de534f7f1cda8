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

}  // namespace veriray
