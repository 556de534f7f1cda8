// Flat convex primitives of small scenes: parallelograms (two slabs) and polygons of up to four
// edges. Both find the point on the plane and test it against edge functions that are planes too.
//
// Neighbours must not leave a gap. So the host widens primitives along shared edges by a rim of
// kEdgeSlack (normalised units), a bound on the rounding of point and edge function: a ray within
// rounding of a shared edge meets one of its primitives or both (scene/flat.cpp). A ray that
// starts within rounding of a neighbour's plane counts as in front of it: records hold the plane
// kPlaneSlack behind the surface.
//
// The back of a one-sided face has no rim along the silhouette of a body, behind which it would
// stick out. Seen from there, the face ends at its own edges, to rounding: at |U.p + w| <= rim[0],
// |V.p + w| <= rim[1] for a quad, e.p + w >= rim[k] for a polygon.
#pragma once

#include "geometry/ray.h"

namespace veriray {

inline constexpr uint32_t kMaxFlat = 64;     // primitives for which no tree is built
inline constexpr uint32_t kQuadFloats = 12;  // plane, {U, w}, {V, w}: |U.p + w| <= 1
// For a quad across axis a: w; U_w, U_b, U_c; V_w, V_b, V_c. For one along it: n_b, n_c, w; U_w,
// U_a; V_w, V_b, V_c.
inline constexpr uint32_t kShortFloats = 8;
inline constexpr uint32_t kPolygonFloats = 20;  // plane, four edges e.p + w >= 0
inline constexpr float kEdgeSlack = 0x1p-20f;
inline constexpr float kPlaneSlack = 0x1p-22f;

// A quad's record as a type of its own: three loads from shared memory.
struct alignas(16) QuadRecord {
    float v[kQuadFloats];
    VR_HD const float& operator[](uint32_t k) const { return v[k]; }
};

// Whether a ray meets the primitive at 0 < t < t_max, and where. A ray within the plane has a t
// that is NaN or beyond the primitive, and fails the test. Record: float, or lanes that are equal.
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
    return between<L>(inside, t, t_max);
}

// A run of quads that share a test: across axis 0, 1 or 2, along axis 0, 1 or 2, or any way. A quad
// along an axis has two edges along it, and two across.
inline constexpr uint32_t kAlong = 3, kAnyWay = 6;
struct QuadRun {
    uint32_t way, end;  // the first quad after it
};

// The same for a parallelogram across an axis or along it, bit for bit: only products with 0, and
// sums with these, are left out.
template <class L, uint32_t kWay, class Record>
VR_HD typename L::M meets_short(const Record* record, const Ray<L>& ray, typename L::F t_max,
                                typename L::F& t) {
    using F = typename L::F;
    constexpr uint32_t a = kWay % 3, b = a == 0 ? 1 : 0, c = a == 2 ? 1 : 2;
    const F o[3] = {ray.o.x, ray.o.y, ray.o.z}, d[3] = {ray.d.x, ray.d.y, ray.d.z};
    F e[2];
    const auto edge = [&](const Record* e, const F* p) {
        return fma(F(e[2]), p[c], fma(F(e[1]), p[b], F(e[0])));
    };
    if constexpr (kWay < kAlong) {
        t = plain_quotient(-(o[a] + F(record[0])), d[a]);
        const Vec3<F> at = ray.at(t);
        const F p[3] = {at.x, at.y, at.z};
        e[0] = edge(record + 1, p), e[1] = edge(record + 4, p);
    } else {
        t = plain_quotient(-fma(F(record[1]), o[c], fma(F(record[0]), o[b], F(record[2]))),
                           fma(F(record[1]), d[c], F(record[0]) * d[b]));
        const Vec3<F> at = ray.at(t);
        const F p[3] = {at.x, at.y, at.z};
        e[0] = fma(F(record[4]), p[a], F(record[3])), e[1] = edge(record + 5, p);
    }
    return between<L>(both_within(e[0], e[1], F(1.f)), t, t_max);
}

}  // namespace veriray
