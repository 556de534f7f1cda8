// Point lights. Lights at a point are sampled together; those with a cone lose some by direction.
#pragma once

#include "lights/shape.h"

namespace veriray {

template <class L>
struct PointLight : LightShape<L> {
    VR_LIGHT_SHAPE(LightShape<L>);
    static constexpr const char *kName = "point", *kFeature = "delta_lights";
    static constexpr LightSite kSite = kAtPoint;

    // Intensity over squared distance.
    template <class Row>
    static VR_HD Sample sample_li(const Row& row, V p, F, F, M lanes, M) {
        const V to = row.vector(kLightP) - p;
        const F d2 = dot(to, to), distance = sqrt(d2);
        const V wi = to * (F(1.f) / distance);
        const S radiance = row.radiance() * (F(1.f) / d2);
        return {radiance, row(kLightInverse), distance * F(kShadowShorten), wi, lanes, U(~0u)};
    }
    template <class Row>
    static VR_HD Emission emit(const Row& row, Numbers r) {
        return {row.vector(kLightP),
                Base::any_direction(r.s, r.t),
                row.radiance(),
                F(1.f),
                F(1.f) / row(kLightInverse),
                F(Base::kAnyPdf)};
    }
    static VR_HD double power(const LightSource& s) { return 4 * kPiDouble * s.strength; }
    // Where the way from a receiver meets an image in front of a light: the columns from column_u
    // and column_v on give u - 1/2 and v - 1/2 on the plane at distance 1.
    template <class Row>
    static VR_HD void on_image(const Row& row, uint32_t column_u, uint32_t column_v, V wi, F& u,
                               F& v) {
        const F ahead = F(1.f) / dot(row.vector(kLightN), wi);
        u = fma(dot(row.vector(column_u), wi), ahead, F(0.5f));
        v = fma(dot(row.vector(column_v), wi), ahead, F(0.5f));
    }
    static LightBound bound(const LightSource& s) { return {s.p, 0, {0, 0, 0}, -1, 0, s.strength}; }
    template <class At>
    static void write(const LightSource& s, At at) {
        Base::write3(at, kLightP, s.p);
        Base::write3(at, kLightN, s.n);
    }
};

}  // namespace veriray
