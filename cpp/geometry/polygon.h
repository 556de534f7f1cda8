// Flat convex primitives of small scenes: parallelograms (two slabs) and polygons of up to four
// edges. Both find the point on the plane and test it against edge functions that are planes too.
//
// Neighbours must not leave a gap: the host widens primitives along the edges they share by
// kEdgeSlack (normalised units), a bound on the rounding of point and edge function, so that a ray
// within rounding of a shared edge meets one of its primitives or both (scene/flat.cpp). A ray that
// starts within rounding of a neighbour's plane counts as in front of it: records hold the plane
// kPlaneSlack behind the surface.
#pragma once

#include "geometry/ray.h"

namespace veriray {

inline constexpr uint32_t kMaxFlat = 64;        // primitives for which no tree is built
inline constexpr uint32_t kQuadFloats = 12;     // plane, {U, w}, {V, w}: |U.p + w| <= 1
inline constexpr uint32_t kPolygonFloats = 20;  // plane, four edges e.p + w >= 0
inline constexpr float kEdgeSlack = 0x1p-20f;
inline constexpr float kPlaneSlack = 0x1p-22f;

// Whether a ray meets the primitive at 0 < t < t_max, and where. A ray within the plane has an
// infinite or NaN t: neither passes. Record: float or lanes that are equal.
template <class L, uint32_t kEdges, class Record>
VR_HD typename L::M meets_flat(const Record* record, const Ray<L>& ray, typename L::F t_max,
                               typename L::F& t) {
    using F = typename L::F;
    t = plane_distance<L>(record, ray);
    const Vec3<F> p = ray.at(t);
    F e[kEdges];
    for (uint32_t k = 0; k < kEdges; ++k) e[k] = height_over<L>(record + 4 + 4 * k, p);
    typename L::M inside;
    if constexpr (kEdges == 2)  // slabs
        inside = both_within(e[0], e[1], F(1.f));
    else
        inside = min(min(e[0], e[1]), min(e[2], e[3])) >= F(0.f);
    return and_less(and_less(inside, F(0.f), t), t, t_max);
}

}  // namespace veriray
