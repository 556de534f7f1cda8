// Projectors: an image on a plane in front of a point, which is as bright on all of any parallel
// plane. The radiance column is what reaches the plane at distance 1, at right angles to it.
#pragma once

#include "lights/point.h"

namespace veriray {

template <class L>
struct ProjectorLight : PointLight<L> {
    VR_LIGHT_SHAPE(PointLight<L>);
    static constexpr const char *kName = "projector", *kFeature = "projectors";
    static constexpr bool kAimed = true, kCone = true, kImage = true, kFramed = true;

    template <class Row>
    static VR_HD void image(const Row& row, V wi, F& u, F& v) {
        Base::on_image(row, kLightE1, kLightE2, wi, u, v);
    }
    template <class Row>
    static VR_HD F falloff(const Row& row, V wi) {
        F u, v;
        image(row, wi, u, v);
        const F zero(0.f), one(1.f), cosine = -dot(row.vector(kLightN), wi);
        const M within = (cosine > zero) & (u >= zero) & (u <= one) & (v >= zero) & (v <= one);
        return select(within, one / (cosine * cosine * cosine), zero);
    }
    // Uniform on the image.
    template <class Row>
    static VR_HD Emission emit(const Row& row, Numbers r) {
        const V a = row.vector(kLightE1), b = row.vector(kLightE2);
        const F a2 = F(1.f) / dot(a, a), b2 = F(1.f) / dot(b, b);
        const V to =
            fma(a, (r.s - F(0.5f)) * a2, fma(b, (r.t - F(0.5f)) * b2, row.vector(kLightN)));
        const F cosine = F(1.f) / sqrt(dot(to, to)), cube = cosine * cosine * cosine;
        Emission e = Base::emit(row, r);
        e.d = to * cosine;
        e.radiance = e.radiance * (F(1.f) / cube);
        e.pdf_sa = F(1.f) / (sqrt(a2 * b2) * cube);
        return e;
    }
    // area: of the image at distance 1.
    static VR_HD double power(const LightSource& s) { return s.area * s.strength; }
    // The cone through the image's corners.
    static LightBound bound(const LightSource& s) {
        const auto square = [](Vec3<double> a) { return a.x * a.x + a.y * a.y + a.z * a.z; };
        const double corner = 0.25 / square(s.image_u) + 0.25 / square(s.image_v);
        return {s.p, 0, s.n, 1 / ieee_sqrt(1 + corner), 1, s.strength};
    }
    template <class At>
    static void write(const LightSource& s, At at) {
        Base::write(s, at);
        Base::write3(at, kLightE1, s.image_u);
        Base::write3(at, kLightE2, s.image_v);
    }
};

}  // namespace veriray
