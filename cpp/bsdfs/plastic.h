// A diffuse base within a smooth coat: mirror or base, chosen by Fresnel's reflectance.
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

template <class L>
struct Plastic : Closure<L> {
    VR_CLOSURE(L);
    static constexpr const char* kName = "plastic";
    static constexpr bool kScatters = true, kIndexed = true;
    // reflectance: of the base within the coat, with the reflections between the two (see
    // scene/surfaces.cpp).
    static constexpr uint32_t kReads = parameter_bit(kParameter_reflectance) |
                                       parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_eta);

    static VR_HD F entering(const View& view, F cos_i) {
        return F(1.f) - fresnel_dielectric(min(cos_i, F(1.f)), view.relative).reflected;
    }
    // Of the base: light enters, on the average over the hemisphere, nearly as at cosine 1/2.
    static VR_HD S albedo(const Parameters& p, const View& view) {
        const F r = view.fresnel.reflected;
        return p.specular_reflectance * r +
               p.reflectance * (entering(view, F(0.5f)) * (F(1.f) - r));
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V, V, F cos_i) {
        const F pdf = cosine_hemisphere_pdf_sa(cos_i), base = F(1.f) - view.fresnel.reflected;
        return {p.reflectance * pdf * (entering(view, cos_i) * base), pdf * base};
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        F cos_i;
        Sample base = cosine_lobe(view, r.u, r.v, cos_i, nobody);
        base.weight = p.reflectance * entering(view, cos_i);
        base.pdf_sa = base.pdf_sa * (F(1.f) - view.fresnel.reflected);
        const Sample mirror =
            delta(reflected(wo, view.n, view.cos_o), p.specular_reflectance, nobody);
        return chosen(r.lobe < view.fresnel.reflected, mirror, base);
    }
};

}  // namespace veriray
