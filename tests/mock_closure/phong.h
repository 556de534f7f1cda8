// A glossy lobe about the mirror direction beside a diffuse one. B. T. Phong, 1975, normalised as a
// density: what it would send below the surface is lost.
#pragma once

#include "bsdfs/sum.h"

namespace veriray {

template <class L>
struct PhongLobe : Closure<L> {
    VR_CLOSURE(L);
    static constexpr bool kDelta = false;

    static VR_HD F share(const Parameters&, const View&) { return F(0.5f); }
    static VR_HD S albedo(const Parameters& p, const View&) {
        return p.specular_reflectance * F(2.f);
    }
    static VR_HD F density(const Parameters& p, F cosine) {
        const F c = max(cosine, F(0x1p-20f));
        return (p.exponent + F(1.f)) * F(0.159154943f) * exp_minus(-p.exponent * log(c));
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F, F share) {
        const F pdf = share * density(p, dot(reflected(wo, view.n, view.cos_o), wi));
        return {albedo(p, view) * pdf, pdf};
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
        return {wi, select(dot(view.n, wi) > F(0.f), albedo(p, view), lost), density(p, c), nobody,
                nobody};
    }
};

template <class L>
struct LambertLobe : Closure<L> {
    VR_CLOSURE(L);
    static constexpr bool kDelta = false;

    static VR_HD S albedo(const Parameters& p, const View&) { return p.reflectance * F(2.f); }
    static VR_HD Value eval(const Parameters& p, const View& view, V, V, F cos_i, F share) {
        const F pdf = share * cosine_hemisphere_pdf_sa(cos_i);
        return {albedo(p, view) * pdf, pdf};
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V, Numbers r, M nobody) {
        F cos_i;
        Sample s = cosine_lobe(view, r.u, r.v, cos_i, nobody);
        s.weight = albedo(p, view);
        return s;
    }
};

template <class L>
struct Phong : LobeSum<L, PhongLobe<L>, LambertLobe<L>> {
    static constexpr const char* kName = "phong";
    static constexpr uint32_t kReads = parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_reflectance) |
                                       parameter_bit(kParameter_exponent);
};

}  // namespace veriray
