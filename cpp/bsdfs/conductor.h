// A smooth metal: a mirror tinted by Fresnel's equations for a complex index.
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

template <class L>
struct Conductor : Closure<L> {
    VR_CLOSURE(L);
    static constexpr const char* kName = "conductor";
    static constexpr uint32_t kReads = parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_eta) | parameter_bit(kParameter_k);

    static VR_HD S albedo(const Parameters& p, const View& view) {
        const F c = min(view.cos_o, F(1.f));
        const S fresnel = S::of([&](uint32_t i) { return fresnel_conductor(c, p.eta[i], p.k[i]); });
        return p.specular_reflectance * fresnel;
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers, M nobody) {
        return delta(reflected(wo, view.n, view.cos_o), albedo(p, view), nobody);
    }
};

}  // namespace veriray
