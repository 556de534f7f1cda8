// Scattering by specular microflakes whose normals are spread like those of an ellipsoid: E. Heitz,
// J. Dupuy, C. Crassin, C. Dachsbacher, "The SGGX Microflake Distribution", SIGGRAPH 2015.
//
// The symmetric matrix S is M M^T with M lower triangular. Normals m are in proportion to M u with
// u evenly on the sphere, so those that a ray sees are the same with u spread by its cosine about
// M^T w, where w points back along the ray. The area that it sees, sqrt(w S w), is the length of
// M^T w, and D(m) = 1 / (pi det(M) |M^-1 m|^4). The extinction along a ray is in proportion to that
// area, and the phase function D(h) / (4 area) with h halfway between w and the new direction; it
// depends on both directions, and is not reciprocal without the area.
#pragma once

#include "core/mapping.h"

namespace veriray {

inline constexpr uint32_t kFlakeFloats =
    13;  // of a lobe: M and its inverse by rows, 1 / (4 pi det)

template <class F>
struct Flakes {
    F m[kFlakeFloats];

    // M^T v.
    VR_HD Vec3<F> across(Vec3<F> v) const {
        return {fma(m[0], v.x, fma(m[1], v.y, m[3] * v.z)), fma(m[2], v.y, m[4] * v.z), m[5] * v.z};
    }
    // Their area as seen along d.
    VR_HD F area(Vec3<F> d) const {
        const Vec3<F> a = across(d);
        return sqrt(dot(a, a));
    }
    // Of a path that goes on along wi from d, both of unit length.
    VR_HD F value(Vec3<F> d, Vec3<F> wi) const {
        Vec3<F> x, y;
        orthonormal_frame(d, x, y);
        const Vec3<F> apart = wi - d;
        // Straight on, any normal across d is halfway.
        const auto straight = dot(apart, apart) == F(0.f);
        const Vec3<F> h = select(straight, x, apart);
        const F* i = m + 6;
        const Vec3<F> u{i[0] * h.x, fma(i[1], h.x, i[2] * h.y),
                        fma(i[3], h.x, fma(i[4], h.y, i[5] * h.z))};
        const F share = dot(h, h) / dot(u, u);
        return m[12] * (share * share) / area(d);
    }
    // A direction that a path goes on along from d. u, v in [0, 1).
    VR_HD Vec3<F> draw(Vec3<F> d, F u, F v) const {
        const Vec3<F> seen = -across(d);
        Vec3<F> x, y;
        const Vec3<F> up = seen * (F(1.f) / sqrt(dot(seen, seen)));
        orthonormal_frame(up, x, y);
        const Vec3<F> c = cosine_hemisphere(u, v);
        const Vec3<F> q = fma(x, c.x, fma(y, c.y, up * c.z));
        const Vec3<F> n{m[0] * q.x, fma(m[1], q.x, m[2] * q.y),
                        fma(m[3], q.x, fma(m[4], q.y, m[5] * q.z))};
        // d - 2 (d n) n / (n n), with -d n = cos |M^T d|.
        const F turn = F(2.f) * c.z * sqrt(dot(seen, seen)) / dot(n, n);
        const Vec3<F> wi = fma(n, turn, d);
        return wi * (F(1.f) / sqrt(dot(wi, wi)));
    }
};

}  // namespace veriray
