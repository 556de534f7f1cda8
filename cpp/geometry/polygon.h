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
inline constexpr uint32_t kQuadFloats = 12;    // plane, U.xyz U.w, V.xyz V.w: |U.p + U.w| <= 1
inline constexpr uint32_t kPolygonFloats = 20; // plane, four edges e.p + e.w >= 0
inline constexpr float kEdgeSlack = 0x1p-20f;

template <class L>
VR_HD typename L::F edge_function(const float* e, Vec3<typename L::F> p) {
    using F = typename L::F;
    return fma(F(e[2]), p.z, fma(F(e[1]), p.y, fma(F(e[0]), p.x, F(e[3]))));
}

template <class L>
VR_HD typename L::M inside_quad(const float* q, Vec3<typename L::F> p) {
    using F = typename L::F;
    return max(abs(edge_function<L>(q + 4, p)), abs(edge_function<L>(q + 8, p))) <= F(1.f);
}

template <class L>
VR_HD typename L::M inside_polygon(const float* q, Vec3<typename L::F> p) {
    using F = typename L::F;
    const F a = min(edge_function<L>(q + 4, p), edge_function<L>(q + 8, p));
    const F b = min(edge_function<L>(q + 12, p), edge_function<L>(q + 16, p));
    return min(a, b) >= F(0.f);
}

}  // namespace veriray
