// A glossy lobe about the mirror direction. B. T. Phong, 1975, normalised as a density: what it
// would send below the surface is lost.
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

template <class L>
struct Phong : Closure<L> {
    VR_CLOSURE(L);
    static constexpr const char* kName = "phong";
    static constexpr bool kScatters = true;
    static constexpr uint32_t kReads =
        parameter_bit(kParameter_specular_reflectance) | parameter_bit(kParameter_exponent);

    static VR_HD S albedo(const Parameters& p, const View&) { return p.specular_reflectance; }
    static VR_HD F density(const Parameters& p, F cosine) {
        const F c = max(cosine, F(0x1p-20f));
        return (p.exponent + F(1.f)) * F(0.159154943f) * exp_minus(-p.exponent * log(c));
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F) {
        const F pdf = density(p, dot(reflected(wo, view.n, view.cos_o), wi));
        return {p.specular_reflectance * pdf, pdf};
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        const V mirror = reflected(wo, view.n, view.cos_o);
        const F c = exp_minus(-log(F(1.f) - r.u) / (p.exponent + F(1.f)));
        const F s = sqrt(max(fma(-c, c, F(1.f)), F(0.f)));
        V a, b;
        orthonormal_frame(mirror, a, b);
        F sine, cosine;
        sincos_2pi(r.v, sine, cosine);
        const V wi = fma(a, s * cosine, fma(b, s * sine, mirror * c));
        const S lost = S::all(F(0.f));
        return {wi, select(dot(view.n, wi) > F(0.f), p.specular_reflectance, lost), density(p, c),
                nobody, nobody};
    }
};

}  // namespace veriray
