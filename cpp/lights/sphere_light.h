// Sphere lights by solid angle: uniform over the cone of directions that meet the sphere or, from
// inside, over all directions.
#pragma once

#include "core/mapping.h"
#include "geometry/sphere.h"

namespace veriray {

template <class F>
struct SphereLightSample {
    Vec3<F> wi;     // unit
    F inverse_pdf;  // the solid angle of the directions
    F distance;     // to the first point of the sphere
    F far;          // to the last
    F cos_light;    // of -wi to the outward normal there: negative if the inside is seen
};

// The sphere as seen from p. p is outside if |p - centre|^2 - r^2 > 0 as `excess` rounds it;
// sample_sphere_light and sphere_light_pdf share this rule.
template <class F>
struct SphereView {
    TwoVec3<F> from;  // p - centre
    F d2, excess;     // |from|^2; |from|^2 - r^2
    F one_minus_cos;  // of the cone of directions that meet the sphere; 2 from inside

    template <class Record>
    VR_HD SphereView(const Record* record, Vec3<F> p) : from(from_centre(record, p)) {
        d2 = dot(from.hi, from.hi);
        excess = veriray::excess(record, from);
        const F r(record[6]);
        // sin^2 / (1 + cos), cos^2 = 1 - (r/d)^2
        const F cone = r * r / d2 / (F(1.f) + sqrt(max(excess / d2, F(0.f))));
        one_minus_cos = select(excess > F(0.f), cone, F(2.f));
    }
};

template <class F, class Record>
VR_HD SphereLightSample<F> sample_sphere_light(const Record* record, Vec3<F> p, F u, F v) {
    const SphereView<F> view(record, p);
    const auto outside = view.excess > F(0.f);
    const F open = view.one_minus_cos, d = sqrt(view.d2);
    const Vec3<F> local = uniform_cone(u, v, open);
    const Vec3<F> up{F(0.f), F(0.f), F(1.f)};
    const Vec3<F> axis = select(d > F(0.f), view.from.hi * (F(-1.f) / d), up);  // to the centre
    Vec3<F> a, b;
    orthonormal_frame(axis, a, b);
    // The roots of t^2 - 2 middle t + excess; the square of half the chord, from outside, is
    // d^2 (sin^2 of the cone - sin^2 of wi).
    const F middle = d * local.z;
    const F half =
        sqrt(select(outside, view.d2 * open * (F(1.f) - u) * (F(2.f) - open * (F(1.f) + u)),
                    fma(middle, middle, -view.excess)));
    const F far = middle + select(middle < F(0.f), -half, half), near = view.excess / far;
    SphereLightSample<F> s;
    s.wi = fma(a, local.x, fma(b, local.y, axis * local.z));
    s.inverse_pdf = F(2.f * kPi) * open;
    s.distance = select(outside | (middle < F(0.f)), near, far);
    s.far = max(near, far);
    s.cos_light = select(outside, half, -half) / F(record[6]);
    return s;
}

template <class F, class Record>
VR_HD F sphere_light_pdf(const Record* record, Vec3<F> p) {
    return uniform_cone_pdf_sa(SphereView<F>(record, p).one_minus_cos);
}

}  // namespace veriray
