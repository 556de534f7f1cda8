// Spot lights: point lights whose intensity falls to 0 from beam to cutoff, linear in the angle, as
// Mitsuba's.
#pragma once

#include "core/math.h"
#include "lights/point.h"

namespace veriray {

inline constexpr uint32_t kSpotCutoff = kLightE1;          // radians
inline constexpr uint32_t kSpotInverse = kSpotCutoff + 1;  // 1 / (cutoff - beam)
// Of an image, in front of the light on the plane at distance 1: 3 columns each.
inline constexpr uint32_t kSpotImageU = kLightE2, kSpotImageV = kLightMore;

// Sine and cosine of an angle in degrees in [0, 180], by halving and Taylor series: the same on
// every machine.
VR_HD void sin_cos_degrees(double degrees, double& s, double& c) {
    const double x = degrees * (kPiDouble / 180) / 16;
    double term = 1, sine = 0, cosine = 1;
    for (int n = 1; n < 20; n += 2) {
        term *= x / n;
        sine += term;
        term *= -x / (n + 1);
        cosine += term;
    }
    for (int k = 0; k < 4; ++k) {
        const double twice = 2 * sine * cosine;
        cosine = 1 - 2 * sine * sine;
        sine = twice;
    }
    s = sine, c = cosine;
}

template <class L>
struct SpotLight : PointLight<L> {
    VR_LIGHT_SHAPE(PointLight<L>);
    static constexpr const char *kName = "spot", *kFeature = "delta_lights";
    static constexpr bool kAimed = true, kCone = true, kImage = true;

    // By sine and cosine: a cosine alone does not tell small angles apart.
    template <class Row>
    static VR_HD F falloff(const Row& row, V wi) {
        const V axis = row.vector(kLightN), across = cross(wi, axis);
        const F off = angle(-dot(wi, axis), sqrt(dot(across, across)));
        const F edge = (row(kSpotCutoff) - off) * row(kSpotInverse);
        return max(min(edge, F(1.f)), F(0.f));
    }
    template <class Row>
    static VR_HD void image(const Row& row, V wi, F& u, F& v) {
        Base::on_image(row, kSpotImageU, kSpotImageV, wi, u, v);
    }
    // Uniform in the cone.
    template <class Row>
    static VR_HD Emission emit(const Row& row, Numbers r) {
        F s, c;
        sincos_2pi(row(kSpotCutoff) * F(0.25f * kInvPi), s, c);
        const F open = F(2.f) * s * s;  // 1 - cos
        const V axis = row.vector(kLightN), local = uniform_cone(r.s, r.t, open);
        V a, b;
        orthonormal_frame(axis, a, b);
        Emission e = Base::emit(row, r);
        e.d = fma(a, local.x, fma(b, local.y, axis * local.z));
        e.radiance = e.radiance * falloff(row, -e.d);
        e.pdf_sa = uniform_cone_pdf_sa(open);
        return e;
    }
    static VR_HD double power(const LightSource& light) {
        const double width = (light.cutoff - light.beam) * (kPiDouble / 180);
        double mean, s, s2;  // cosine, over the angles of the linear edge
        sin_cos_degrees(light.cutoff, s, mean);
        if (width > 1e-6) {
            sin_cos_degrees(light.beam, s2, mean);
            mean = (s - s2) / width;
        }
        return 2 * kPiDouble * (1 - mean) * light.strength;
    }
    // As if its intensity fell with the cosine of the angle, to 0 at the same one.
    static LightBound bound(const LightSource& light) {
        double sine, beam, edge;
        sin_cos_degrees(light.beam, sine, beam);
        sin_cos_degrees(light.cutoff - light.beam, sine, edge);
        return {light.p, 0, light.n, beam, edge, light.strength};
    }
    template <class At>
    static void write(const LightSource& s, At at) {
        Base::write(s, at);
        at(kSpotCutoff) = static_cast<float>(s.cutoff * (kPiDouble / 180));
        const double width = (s.cutoff - s.beam) * (kPiDouble / 180);
        at(kSpotInverse) = static_cast<float>(width > 1e-9 ? 1 / width : 1e9);
        Base::write3(at, kSpotImageU, s.image_u);
        Base::write3(at, kSpotImageV, s.image_v);
    }
};

}  // namespace veriray
