// Watertight triangles for meshes.
//
// Vertices are sheared along the ray onto a plane by the same arithmetic for every triangle. The
// sign of an edge function there follows from comparing two products that are rounded alike for
// both neighbours (never fused). A rounded product is monotone, so the sign is right or zero, and
// zero counts as inside: no ray passes between two triangles that share an edge or a vertex.
// S. Woop, C. Benthin, I. Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013.
#pragma once

#include "geometry/ray.h"

namespace veriray {

// 1 / d, kept finite so that its product with 0 is 0 on a slab's face.
template <class F>
VR_HD F finite_inverse(F d) {
    return select(abs(d) < F(0x1p-100f), F(0x1p100f), F(1.f) / d);
}

// Where a ray meets planes across the axes: at fma(c, inverse, near) for the plane at c. `near` is
// early and `far` late by `slack` times the origin's largest coordinate (at least 1). kSlabSlack is
// more than the rounding of shear, plane and slab together; kMovedSlack is for scenes whose planes
// have been moved (scene/touching.cpp).
inline constexpr float kSlabSlack = 0x1p-20f, kMovedSlack = 0x1p-17f;

template <class L>
struct Slabs {
    Vec3<typename L::F> inverse, near, far;
};

template <class L>
VR_HD Slabs<L> slabs_of(const Ray<L>& ray, float slab_slack) {
    using F = typename L::F;
    const Vec3<F> o = ray.o;
    const F slack = F(slab_slack) * max(max(abs(o.x), abs(o.y)), max(abs(o.z), F(1.f)));
    Slabs<L> s;
    s.inverse = {finite_inverse(ray.d.x), finite_inverse(ray.d.y), finite_inverse(ray.d.z)};
    const Vec3<F> w{abs(s.inverse.x) * slack, abs(s.inverse.y) * slack, abs(s.inverse.z) * slack};
    s.near = fma(-o, s.inverse, -w);
    s.far = fma(-o, s.inverse, w);
    return s;
}

// The ray's main axis, exchanged with z; x and y shear by dx/dz and dy/dz.
template <class L>
struct Shear {
    typename L::M from_x, from_y;  // the main axis is x, is y
    typename L::F x, y;            // -dx/dz, -dy/dz after the exchange
};

// v with the ray's main axis last.
template <class F, class M>
VR_HD Vec3<F> main_axis_last(M from_x, M from_y, Vec3<F> v) {
    return {select(from_x, v.z, v.x), select(from_y, v.z, v.y),
            select(from_x, v.x, select(from_y, v.y, v.z))};
}

template <class L>
VR_HD Shear<L> shear_of(Vec3<typename L::F> d) {
    using F = typename L::F;
    const F x = abs(d.x), y = abs(d.y), z = abs(d.z);
    Shear<L> s;
    s.from_x = (x > z) & (x >= y);
    s.from_y = (y > z) & (y > x);
    const Vec3<F> m = main_axis_last(s.from_x, s.from_y, d);
    s.x = -m.x / m.z;
    s.y = -m.y / m.z;
    return s;
}

// Whether the ray's line meets the triangle with corners v (relative to the ray's origin, main axis
// last); false for a triangle seen edge-on.
template <class L>
VR_HD typename L::M inside_sheared(const Shear<L>& s, const Vec3<typename L::F> (&v)[3]) {
    using F = typename L::F;
    F x[3], y[3];
    for (int i = 0; i < 3; ++i) {
        x[i] = fma(s.x, v[i].z, v[i].x);
        y[i] = fma(s.y, v[i].z, v[i].y);
    }
    const F e0 = x[1] * y[2] - y[1] * x[2];
    const F e1 = x[2] * y[0] - y[2] * x[0];
    const F e2 = x[0] * y[1] - y[0] * x[1];
    const F least = min(min(e0, e1), e2), most = max(max(e0, e1), e2);
    const auto left = least >= F(0.f), right = most <= F(0.f);
    return (left | right) & !(left & right);
}

// Distance to the plane, but not less than where the ray enters the box about the corners v. So
// boxes may be skipped by distance, even if the ray grazes the plane. 0 if the ray misses that box
// by the arithmetic of the nodes' boxes, which enclose it: then the edge functions were equally
// rounded products of a distant triangle that is edge-on and points at the line. No other hit is
// lost: the sheared corners are off by at most 5/8 and slabs by 5/16 of kSlabSlack.
template <class L>
VR_HD typename L::F bounded_distance(typename L::F t, const Slabs<L>& s,
                                     const Vec3<typename L::F> (&v)[3]) {
    using F = typename L::F;
    const auto entry = [](F a, F b, F c, F inverse, F near) {
        return min(min(fma(a, inverse, near), fma(b, inverse, near)), fma(c, inverse, near));
    };
    const auto leave = [](F a, F b, F c, F inverse, F far) {
        return max(max(fma(a, inverse, far), fma(b, inverse, far)), fma(c, inverse, far));
    };
    const F box = max(max(entry(v[0].x, v[1].x, v[2].x, s.inverse.x, s.near.x),
                          entry(v[0].y, v[1].y, v[2].y, s.inverse.y, s.near.y)),
                      entry(v[0].z, v[1].z, v[2].z, s.inverse.z, s.near.z));
    const F end = min(min(leave(v[0].x, v[1].x, v[2].x, s.inverse.x, s.far.x),
                          leave(v[0].y, v[1].y, v[2].y, s.inverse.y, s.far.y)),
                      leave(v[0].z, v[1].z, v[2].z, s.inverse.z, s.far.z));
    const F at = select((t > box) & (t < F(kInfinity)), t, box);
    return select(max(box, F(0.f)) <= end, at, F(0.f));
}

}  // namespace veriray
