// Spheres by solid angle: uniform in the cone of directions that meet the sphere, or, from inside,
// in all directions. A row has the sphere's record from kLightP on, and in kLightN its side: 1
// outside, -1 inside, -2 inside of a surface that lets light through.
#pragma once

#include "geometry/sphere.h"
#include "lights/shape.h"

namespace veriray {

template <class F>
struct SphereLightSample {
    Vec3<F> wi;      // unit
    F inverse_pdf;   // the solid angle of the directions
    F distance;      // to the first point of the sphere
    F far;           // to the last
    F cos_light;     // of -wi to the outward normal there: negative where the inside is seen
    Vec3<F> across;  // what lies at right angles to wi of the normal at either point
};

// The sphere as seen from p. p is outside where |p - centre|^2 - r^2 > 0 as `excess` rounds it:
// the one rule for sample_sphere_light and sphere_light_pdf.
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
    const F sine2 = fma(local.x, local.x, local.y * local.y);
    s.across =
        fma(a, local.x * local.z, fma(b, local.y * local.z, axis * -sine2)) * (d / record[6]);
    return s;
}

template <class F, class Record>
VR_HD F sphere_light_pdf(const Record* record, Vec3<F> p) {
    return uniform_cone_pdf_sa(SphereView<F>(record, p).one_minus_cos);
}

// A sphere is convex, so that it hides none of its own points that p can see: it is skipped by the
// shadow ray. From outside, its inside is seen across its own surface, where that lets light
// through: there the shadow ray ends before the far side.
template <class L>
struct SphereLight : LightShape<L> {
    VR_LIGHT_SHAPE(LightShape<L>);
    static constexpr const char *kName = "sphere", *kFeature = "sphere_lights";
    static constexpr bool kOwnPdf = true, kRound = true, kSkips = true;

    template <class Row>
    static VR_HD void record_of(const Row& row, F record[kSphereFloats]) {
        for (uint32_t k = 0; k < kSphereFloats; ++k) record[k] = row(kLightP + k);
    }

    template <class Row>
    static VR_HD Sample sample_li(const Row& row, V p, V from, F u, F v, M, M nobody) {
        F record[kSphereFloats];
        record_of(row, record);
        // Of what is so near that it may be on the sphere, `from` alone tells the side. 2^-20: of
        // the distance from the middle, which is a radius there, four times the rounding.
        const V apart = from - p, middle = V{record[0], record[1], record[2]} - from;
        const F height = abs(sqrt(dot(middle, middle)) - record[6]);
        const F resolved = max(fma(record[6], F(-0x1p-20f), height), F(0.f)) * F(0x1p-7f);
        const V seen = select(dot(apart, apart) < resolved * resolved, p, from);
        const SphereLightSample<F> at = sample_sphere_light(record, seen, u, v);
        const F side = row(kLightN);
        const M across = (side < F(-1.f)) & (at.cos_light > F(0.f));
        const M lit = across | ((at.cos_light * side) > F(0.f));
        const V to = fma(at.wi, select(across, at.far, at.distance), seen - from);
        const F distance = sqrt(dot(to, to));
        return {select(lit, row.radiance(), S::all(F(0.f))),
                row(kLightInverse) * at.inverse_pdf,
                distance * select(across, F(kShadowShorten), F(1.f)),
                at.wi,
                nobody,
                select(across, U(~0u), as_uint(row(kLightPrimitive))),
                as_uint(row(kLightPrimitive)),
                fma(at.wi, select(across, at.cos_light, -at.cos_light), at.across),
                to * (F(1.f) / distance)};
    }
    template <class Row>
    static VR_HD Pdf pdf_li(const Row& row, const Hit& at) {
        F record[kSphereFloats];
        record_of(row, record);
        return {at.chance * sphere_light_pdf(record, at.from), F(1.f)};
    }
    template <class Row>
    static VR_HD V point(const Row& row, V outward) {
        F record[kSphereFloats];
        record_of(row, record);
        const V centre{record[0], record[1], record[2]}, low{record[3], record[4], record[5]};
        return fma(outward, record[6], centre) + low;
    }
    // The point, off the sphere as paths leave it.
    template <class Row>
    static VR_HD Emission emit(const Row& row, Numbers r) {
        const V out = Base::any_direction(r.u, r.v);
        const F side = select(row(kLightN) < F(0.f), F(-1.f), F(1.f)), radius = row(kLightP + 6);
        Emission e;
        e.p = point(row, out);
        const F offset =
            fma(sqrt(dot(e.p, e.p)), F(kSphereOffset), radius * F(kSphereOffsetRadius));
        const V n = out * side;
        e.p = fma(n, offset, e.p);
        e.d = Base::lambert(n, r.s, r.t, e.cosine);
        e.radiance = row.radiance();
        e.pdf_area = F(Base::kAnyPdf) / (row(kLightInverse) * radius * radius);
        e.pdf_sa = cosine_hemisphere_pdf_sa(e.cosine);
        return e;
    }
    static VR_HD double power(const LightSource& s) { return kPiDouble * s.area * s.strength; }
    static_assert(kSphereFloats == sizeof(LightSource::record) / sizeof(float));
    // As bright as its cross section.
    static LightBound bound(const LightSource& s) {
        const auto sum = [&](int k) {
            return static_cast<double>(s.record[k]) + static_cast<double>(s.record[3 + k]);
        };
        const double radius = static_cast<double>(s.record[6]);
        return {{sum(0), sum(1), sum(2)}, radius, {0, 0, 0}, -1, 0, 0.25 * s.area * s.strength};
    }
    template <class At>
    static void write(const LightSource& s, At at) {
        for (uint32_t k = 0; k < kSphereFloats; ++k) at(kLightP + k) = s.record[k];
        at(kLightN) = s.side;
    }
};

}  // namespace veriray
