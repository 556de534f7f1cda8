// Point lights. Lights at a point are sampled together; those with a cone lose some by direction.
#pragma once

#include "lights/shape.h"
#include "lights/true_way.h"

namespace veriray {

template <class L>
struct PointLight : LightShape<L> {
    VR_LIGHT_SHAPE(LightShape<L>);
    static constexpr const char *kName = "point", *kFeature = "delta_lights";
    static constexpr LightSite kSite = kAtPoint;

    // Intensity over squared distance, for the receiver p whose shadow rays start at `from`.
    template <class Row>
    static VR_HD Sample sample_li(const Row& row, V p, V from, M lanes) {
        const V to = row.vector(kLightP) - from;
        const F distance = sqrt(dot(to, to));
        F inverse = F(1.f) / distance;
        const V aim = to * inverse, wi = true_way(to, from - p, inverse);
        const S radiance = row.radiance() * (inverse * inverse);
        return {
            radiance, row(kLightInverse), distance * F(kShadowShorten), wi, lanes, U(~0u), U(), V(),
            aim};
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
