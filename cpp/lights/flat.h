// Flat lamps: places p + u e1 + v e2. Those of one set are sampled together: a shape states how it
// draws u and v, and shares the rest.
#pragma once

#include "lights/shape.h"
#include "lights/true_way.h"

namespace veriray {

// Bits: of two triangles, the one with u >= v. The other is kLightPrimitive.
inline constexpr uint32_t kLightOther = kLightMore;

template <class L>
struct FlatPlace {
    typename L::F u, v;
    typename L::U skip;      // as of a LightSample
    typename L::M by_angle;  // drawn by solid angle: of
    typename L::F share;     // the area
};

// A shape states spread(u, v, a, b), uniform on the area; and place(row, p, u, v, lanes, at), which
// draws some places by solid angle.
template <class L, class Shape>
struct FlatLight : LightShape<L> {
    VR_LIGHT_SHAPE(LightShape<L>);
    static constexpr bool kFlat = true;
    // The middle is p + kMiddle (e1 + e2); the corners hold the lamp between them.
    static constexpr double kMiddle = 0.5;
    static Vec3<double> corner(const LightSource& s, int k) {
        return s.p + s.e1 * (k & 1 ? 1. : 0.) + s.e2 * (k & 2 ? 1. : 0.);
    }

    // The point, off the lamp.
    template <class Row>
    static VR_HD Emission emit(const Row& row, Numbers r) {
        F a = r.u, b = r.v;
        if constexpr (Shape::kSpreads) Shape::spread(r.u, r.v, a, b);
        const V n = row.vector(kLightN);
        Emission e;
        e.p = fma(row.vector(kLightE1), a, fma(row.vector(kLightE2), b, row.vector(kLightP)));
        e.p = fma(n, abs(row(kLightOffset)), e.p);
        e.d = Base::lambert(n, r.s, r.t, e.cosine);
        e.radiance = row.radiance();
        e.pdf_area = F(1.f) / row(kLightInverse);
        e.pdf_sa = cosine_hemisphere_pdf_sa(e.cosine);
        return e;
    }
    static VR_HD double power(const LightSource& s) { return kPiDouble * s.area * s.strength; }
    static LightBound bound(const LightSource& s) {
        const Vec3<double> at = s.p + (s.e1 + s.e2) * Shape::kMiddle;
        double square = 0;  // of the distance of the corners
        for (int k = 0; k < 4; ++k) {
            const Vec3<double> a = Shape::corner(s, k) - at;
            const double own = a.x * a.x + a.y * a.y + a.z * a.z;
            square = square < own ? own : square;
        }
        return {at, ieee_sqrt(square), s.n, 1, 0, s.area * s.strength};
    }
    template <class At>
    static void write(const LightSource& s, At at) {
        Base::write3(at, kLightP, s.p);
        Base::write3(at, kLightE1, s.e1);
        Base::write3(at, kLightE2, s.e2);
        Base::write3(at, kLightN, s.n);
        at(kLightOffset) = s.offset;
    }
};

// p: the receiver; from: where its shadow rays start. They must end before the light itself: the
// point is moved off the light by the bound on the absolute rounding of its plane's distance, and
// the ray shortened by a bound on the relative one (plane distance, length and their division:
// below 6 units of 2^-24). By solid angle, and on a light that touches something, the point stays,
// as moving it would change the density of directions near to the light, and the ray ends before
// the moved plane. kByAngle: some places are by solid angle. kTouching: some lights touch what lets
// light through.
template <class L, bool kByAngle, bool kTouching, class Row>
VR_HD LightSample<L> sample_flat(const Row& row, Vec3<typename L::F> p, Vec3<typename L::F> from,
                                 const FlatPlace<L>& at, typename L::M nobody) {
    using F = typename L::F;
    using V = Vec3<F>;
    LightSample<L> s;
    s.delta = nobody;
    s.skip = s.on = at.skip;
    typename L::M stays = at.by_angle;
    F offset = row(kLightOffset);
    if constexpr (kTouching) {
        stays = stays | (offset < F(0.f));
        offset = abs(offset);
    }
    const V n = row.vector(kLightN);
    V q = fma(row.vector(kLightE1), at.u, fma(row.vector(kLightE2), at.v, row.vector(kLightP)));
    s.place = q;
    const F off = select(stays, F(0.f), offset);
    const V to = fma(n, off, q) - from;
    const F distance = sqrt(dot(to, to));
    F inverse = F(1.f) / distance;
    s.distance = distance * F(kShadowShorten);
    s.aim = to * inverse;
    s.wi = true_way(to, from - p - n * off, inverse);
    const F cos_light = -dot(n, s.wi);
    s.radiance = select(cos_light > F(0.f), row.radiance(), Spectrum<F>::all(F(0.f)));
    s.inverse_pdf = row(kLightInverse) * (inverse * inverse) * cos_light;
    if constexpr (kByAngle)
        s.inverse_pdf = select(at.by_angle, row(kLightInverse) * at.share, s.inverse_pdf);
    if constexpr (kByAngle || kTouching)
        s.distance = select(stays, max(s.distance - offset / cos_light, F(0.f)), s.distance);
    return s;
}

}  // namespace veriray
