// Spheres, exact where float32 fails: small and far, large and near, seen from within, left at a
// grazing angle. Positions relative to the centre are sums of two floats.
// After E. Haines, J. Guenther, T. Akenine-Moeller, "Precision Improvements for Ray/Sphere
// Intersection", Ray Tracing Gems, 2019: the discriminant from the ray's point nearest to the
// centre, the roots from a sum without cancellation; here with compensated sums.
#pragma once

#include "core/compensated.h"
#include "geometry/ray.h"

namespace veriray {

inline constexpr uint32_t kSphereFloats = 8;  // centre, its low part, radius, its low part

// The functions below take a record of floats (equal in all lanes) or of lanes.

// p - centre.
template <class F, class Record>
VR_HD TwoVec3<F> from_centre(const Record* record, Vec3<F> p) {
    const auto component = [&](F a, uint32_t k) {
        const Two<F> sum = two_sum(a, -F(record[k]));
        return two_sum(sum.hi, sum.lo - F(record[k + 3]));
    };
    const Two<F> x = component(p.x, 0), y = component(p.y, 1), z = component(p.z, 2);
    return {{x.hi, y.hi, z.hi}, {x.lo, y.lo, z.lo}};
}

// |f|^2 - r^2, to about 2^-46 of the larger.
template <class F, class Record>
VR_HD F excess(const Record* record, const TwoVec3<F>& f) {
    const F r(record[6]), r_low(record[7]);
    const Two<F> r2 = two_product(r, -r);
    const Two<F> sum = add_dot({r2.hi, fma(F(-2.f) * r, r_low, r2.lo)}, f, f.hi);
    return sum.hi + (sum.lo + dot(f.lo, f.hi));
}

// A line against a sphere: it meets the sphere at t with t^2 - 2 middle t + outside = 0.
template <class F>
struct Chord {
    F middle;   // t of the point nearest to the centre
    F square;   // of half the chord; negative: no chord
    F outside;  // |o - centre|^2 - r^2

    VR_HD F half() const { return sqrt(max(square, F(0.f))); }
    // The root of larger magnitude; the other one is outside / far.
    VR_HD F far_root() const { return middle + select(middle < F(0.f), -half(), half()); }
};

template <class F, class Record>
VR_HD Chord<F> chord(const Record* record, Vec3<F> o, Vec3<F> d) {
    const TwoVec3<F> f = from_centre(record, o);
    const Two<F> b = add_dot({F(0.f), F(0.f)}, f, d);
    Chord<F> c;
    c.middle = -(b.hi + b.lo);
    c.outside = excess(record, f);
    const TwoVec3<F> nearest = fma(d, c.middle, f);
    const F along = dot(nearest.hi, d);  // what the rounding of `middle` and of |d| leaves
    c.square = fma(along, along, -excess(record, nearest));
    return c;
}

// False only for rays that clearly miss the sphere in 0 < t < t_max. It spares them `chord`, which
// is ten times the work.
template <class L, class Record>
VR_HD typename L::M may_meet_sphere(const Record* record, const Ray<L>& ray, typename L::F t_max) {
    using F = typename L::F;
    const Vec3<F> f = ray.o - broadcast<F>(record) - broadcast<F>(record + 3);
    const F r(record[6]), middle = -dot(f, ray.d);
    const F reach = fma(abs(f.x) + abs(f.y) + (abs(f.z) + r), F(0x1p-20f), r);
    const Vec3<F> apart = fma(ray.d, middle, f);
    return (dot(apart, apart) <= reach * reach) & (-reach <= middle) & (middle - reach <= t_max);
}

// The next greater number if t > 0; otherwise t.
template <class F>
VR_HD F just_beyond(F t) {
    using U = decltype(as_uint(t));
    return select(t > F(0.f), as_float(as_uint(t) + U(1u)), t);
}

// Whether a ray meets the sphere, and where: lo < hi if lo is ahead, so a ray that enters leaves.
// Relative error: 2e-7 for origins 1e-6 to 1e6 radii off the surface,
// outside and inside (veriray_validate/levels/geometry.py).
template <class L, class Record>
VR_HD typename L::M sphere_roots(const Record* record, const Ray<L>& ray, typename L::F& lo,
                                 typename L::F& hi) {
    using F = typename L::F;
    const Chord<F> c = chord(record, ray.o, ray.d);
    const F far = c.far_root(), near = c.outside / far;
    lo = min(near, far), hi = max(max(near, far), just_beyond(lo));
    return c.square >= F(0.f);
}

// Whether a ray meets the sphere, which is `primitive`, beyond `last` and before t_max, and where
// first.
template <class L, class Record>
VR_HD typename L::M meets_sphere(const Record* record, const Ray<L>& ray, const Hit<L>& last,
                                 typename L::U primitive, typename L::F t_max, typename L::F& t) {
    using F = typename L::F;
    t = t_max;
    const auto close = may_meet_sphere<L>(record, ray, t_max);
    if (none(close)) return close;
    F lo, hi;
    const auto met = sphere_roots<L>(record, ray, lo, hi);
    t = select(beyond<L>(last, lo, primitive), lo, hi);
    return and_less(met & beyond<L>(last, t, primitive), t, t_max);
}
template <class L, class Record>
VR_HD typename L::M meets_sphere(const Record* record, const Ray<L>& ray, typename L::F t_max,
                                 typename L::F& t) {
    return meets_sphere<L>(record, ray, nothing_met<L>(), typename L::U(0u), t_max, t);
}

// A point put on a sphere and then moved along its normal n is rounded three times. Its height is
// off by at most 3 2^-24 (|n.x p.x| + |n.y p.y| + |n.z p.z|) <= 3 2^-24 |p|, and by the rounding of
// `excess`, 2^-45 r. A point at that distance is distinct from the surface in any direction.
inline constexpr float kSphereOffset = 0x1p-22f, kSphereOffsetRadius = 0x1p-42f;

template <class F>
struct SpherePoint {
    Vec3<F> p;  // on the sphere to within rounding
    Vec3<F> n;  // unit, outward
    F offset;   // of a ray's origin from the surface along n or -n, to clear the rounding of p
};

// The point at t of a ray that meets the sphere at t.
template <class F, class Record>
VR_HD SpherePoint<F> sphere_point(const Record* record, Vec3<F> o, Vec3<F> d, F t) {
    const TwoVec3<F> f = fma(d, t, from_centre(record, o));
    // The remaining distance to the sphere: the root of smaller magnitude, or the middle of a
    // tangent.
    const F b = dot(f.hi, d), c = excess(record, f), square = fma(b, b, -c);
    const F half = sqrt(max(square, F(0.f)));
    const F rest = select(square > F(0.f), -c / (b + select(b < F(0.f), -half, half)), -b);
    const Vec3<F> from = fma(d, rest, f.hi);
    SpherePoint<F> s;
    s.n = from * (F(1.f) / sqrt(dot(from, from)));
    s.p = fma(d, rest, fma(d, t, o));
    s.offset = fma(sqrt(dot(s.p, s.p)), F(kSphereOffset), F(record[6]) * F(kSphereOffsetRadius));
    return s;
}

}  // namespace veriray
