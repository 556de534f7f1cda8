// A thin slab of glass: mirror or straight through, all internal reflections included.
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

template <class L>
struct ThinDielectric : Closure<L> {
    VR_CLOSURE(L);
    static constexpr const char* kName = "thindielectric";
    static constexpr bool kClear = true, kPasses = true, kIndexed = true;
    static constexpr uint32_t kReads = parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_specular_transmittance) |
                                       parameter_bit(kParameter_eta);

    static VR_HD FresnelSplit<F> split(FresnelSplit<F> one) {
        const F r = one.reflected;
        return {select(r < F(1.f), (r + r) / (F(1.f) + r), F(1.f)), one.cos_t};
    }
    static VR_HD S albedo(const Parameters& p, const View& view) {
        return p.specular_reflectance * view.fresnel.reflected + pass_through(p, view);
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        const M mirror = r.lobe < view.fresnel.reflected, through = !mirror;
        return {select(mirror, reflected(wo, view.n, view.cos_o), -wo),
                select(mirror, p.specular_reflectance, p.specular_transmittance), F(0.f), nobody,
                through};
    }
    static VR_HD Sample sample_again(const Parameters& p, const View& view, V wo, M through) {
        return delta(reflected(wo, view.n, view.cos_o), p.specular_reflectance, through & !through);
    }
    static VR_HD S pass_through(const Parameters& p, const View& view) {
        return p.specular_transmittance * (F(1.f) - view.fresnel.reflected);
    }
};

}  // namespace veriray
