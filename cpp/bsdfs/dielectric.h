// A smooth interface of two media: mirror or refraction, chosen by Fresnel's reflectance.
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

template <class L>
struct Dielectric : Closure<L> {
    VR_CLOSURE(L);
    static constexpr const char* kName = "dielectric";
    static constexpr bool kClear = true, kRefracts = true, kIndexed = true;
    static constexpr uint32_t kReads = parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_specular_transmittance) |
                                       parameter_bit(kParameter_eta);

    // eta is inside (behind the front) over outside.
    static VR_HD F index(const Parameters& p, M from_front) {
        return select(from_front, p.eta[0], F(1.f) / p.eta[0]);
    }
    static VR_HD S albedo(const Parameters& p, const View& view) {
        const F r = view.fresnel.reflected;
        return p.specular_reflectance * r + p.specular_transmittance * (F(1.f) - r);
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M) {
        return sample_again(p, view, wo, !(r.lobe < view.fresnel.reflected));
    }
    // The mirror under total reflection.
    static VR_HD Sample sample_again(const Parameters& p, const View& view, V wo, M through) {
        const M nobody = through & !through;
        return {
            select(through, refracted(wo, view.n, view.cos_o, view.fresnel.cos_t, view.relative),
                   reflected(wo, view.n, view.cos_o)),
            select(through, p.specular_transmittance * compression(view), p.specular_reflectance),
            F(0.f), through, nobody};
    }
    // Refraction scales radiance as it compresses the solid angle.
    static VR_HD F compression(const View& view) {
        if (view.transport == Transport::kImportance) return F(1.f);
        return F(1.f) / (view.relative * view.relative);
    }
};

}  // namespace veriray
