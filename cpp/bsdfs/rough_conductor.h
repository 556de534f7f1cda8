// A rough metal: small mirrors tinted by Fresnel's equations for a complex index.
#pragma once

#include "bsdfs/microfacet.h"

namespace veriray {

template <class L>
struct RoughConductor : RoughMirror<L> {
    VR_CLOSURE(L);
    using RoughMirror<L>::lobe, RoughMirror<L>::drawn;
    static constexpr const char* kName = "roughconductor";
    static constexpr bool kScatters = true, kThirdNumber = true;
    static constexpr uint32_t kReads = parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_eta) | parameter_bit(kParameter_k) |
                                       kReadsRoughness;

    static VR_HD S colour(const Parameters& p, F cosine) {
        const F c = min(cosine, F(1.f));
        const S fresnel = S::of([&](uint32_t i) { return fresnel_conductor(c, p.eta[i], p.k[i]); });
        return p.specular_reflectance * fresnel;
    }
    // Nearly: that of the smooth metal.
    static VR_HD S albedo(const Parameters& p, const View& view) { return colour(p, view.cos_o); }
    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i) {
        const auto one = lobe(p, view, wo, wi, cos_i);
        return {colour(p, one.cosine) * one.f_cos, one.pdf_sa};
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        const auto one = drawn(p, view, wo, r);
        return {one.wi, colour(p, one.cosine) * one.weight, one.pdf_sa, nobody, nobody};
    }
};

}  // namespace veriray
