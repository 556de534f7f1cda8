// Watertight triangles for meshes.
//
// All vertices are projected along the ray to a plane by the same arithmetic, and the sign of an
// edge function there is decided by comparing two products that are rounded alike for both
// neighbours (never fused). A rounded product is monotone, so the sign is right or zero, and zero
// counts as inside: no ray passes between two triangles that share an edge or a vertex.
// After S. Woop, C. Benthin, I. Wald, "Watertight Ray/Triangle Intersection", JCGT 2(1), 2013;
// a frame about the ray stands for their permuted shear, so that lanes need no permutation.
#pragma once

#include "geometry/ray.h"

namespace veriray {

inline constexpr uint32_t kTriangleFloats = 13;  // three vertices, plane

template <class L>
struct Projection {
    Vec3<typename L::F> u, v;  // orthogonal to the ray
};

// T. Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017.
template <class L>
VR_HD Projection<L> projection(Vec3<typename L::F> d) {
    using F = typename L::F;
    const F sign = select(d.z < F(0.f), F(-1.f), F(1.f));
    const F a = F(-1.f) / (sign + d.z);
    const F b = d.x * d.y * a;
    return {{fma(sign * d.x * d.x, a, F(1.f)), sign * b, -(sign * d.x)},
            {b, fma(d.y * d.y, a, sign), -d.y}};
}

template <class L>
VR_HD typename L::M inside_triangle(const float* tri, const Ray<L>& ray, const Projection<L>& pr) {
    using F = typename L::F;
    F x[3], y[3];
    for (int i = 0; i < 3; ++i) {
        const Vec3<F> a = broadcast<F>(tri + 3 * i) - ray.o;
        x[i] = dot(pr.u, a);
        y[i] = dot(pr.v, a);
    }
    const F p0 = x[1] * y[2], q0 = y[1] * x[2];
    const F p1 = x[2] * y[0], q1 = y[2] * x[0];
    const F p2 = x[0] * y[1], q2 = y[0] * x[1];
    const auto left = (p0 >= q0) & (p1 >= q1) & (p2 >= q2);
    const auto right = (p0 <= q0) & (p1 <= q1) & (p2 <= q2);
    return (left | right) & !(left & right);
}

}  // namespace veriray
