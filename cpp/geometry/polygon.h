// Flat convex primitives of small scenes: parallelograms (two slabs) and polygons of up to four
// edges. Both find the point on the plane and test it against edge functions that are planes too.
//
// Neighbours must not leave a gap: the host widens primitives along the edges they share by
// kEdgeSlack (normalised units), a bound on the rounding of point and edge function, so that a ray
// within rounding of a shared edge meets one of its primitives or both (scene/flat.cpp).
#pragma once

#include "geometry/ray.h"

namespace veriray {

inline constexpr uint32_t kMaxFlat = 64;       // primitives for which no tree is built
inline constexpr uint32_t kQuadFloats = 12;    // plane, {U, w}, {V, w}: |U.p + w| <= 1
inline constexpr uint32_t kPolygonFloats = 20; // plane, four edges e.p + w >= 0
inline constexpr float kEdgeSlack = 0x1p-20f;

template <class L>
VR_HD typename L::M inside_quad(const float* q, Vec3<typename L::F> p) {
    using F = typename L::F;
    return max(abs(height_over<L>(q + 4, p)), abs(height_over<L>(q + 8, p))) <= F(1.f);
}

template <class L>
VR_HD typename L::M inside_polygon(const float* q, Vec3<typename L::F> p) {
    using F = typename L::F;
    const F a = min(height_over<L>(q + 4, p), height_over<L>(q + 8, p));
    const F b = min(height_over<L>(q + 12, p), height_over<L>(q + 16, p));
    return min(a, b) >= F(0.f);
}

}  // namespace veriray
