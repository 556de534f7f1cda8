// A diffuse base within a smooth coat: mirror or base, selected by what they reflect.
#pragma once

#include "bsdfs/sum.h"

namespace veriray {

// A coat of this reflectance is selected by what it and its base send on; it lets about 0.9 of the
// base's light out. Any factor is right, this one has nearly the least variance under an even sky.
template <class F>
VR_HD LobePart<F> part_of_coat(const MaterialParameters<F>& p, F reflected) {
    const F coat = reflected * sum(p.specular_reflectance);
    const F total = fma(F(0.9f) * (F(1.f) - reflected), sum(p.reflectance), coat);
    return {reflected, select(total > F(0.f), coat / total, F(0.f))};
}

template <class L>
struct Coat : Closure<L> {
    VR_CLOSURE(L);
    static constexpr bool kDelta = true;

    static VR_HD LobePart<F> part(const Parameters& p, const View& view) {
        return part_of_coat(p, view.fresnel.reflected);
    }
    static VR_HD S albedo(const Parameters& p, const View&) { return p.specular_reflectance; }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers, F, M nobody) {
        return delta(reflected(wo, view.n, view.cos_o), p.specular_reflectance, nobody);
    }
};

template <class L>
struct SmoothInterface : Closure<L> {
    VR_CLOSURE(L);
    static VR_HD F entering(const View& view, F cos_i) {
        return F(1.f) - fresnel_dielectric(min(cos_i, F(1.f)), view.relative).reflected;
    }
};

// reflectance: of the base, with the reflections between it and the coat (see scene/surfaces.cpp).
// Interface: `entering` is the share of light from cos_i that the coat lets in.
template <class L, class Interface>
struct CoatedBase : Interface {
    VR_CLOSURE(L);
    using Interface::entering;
    static constexpr bool kDelta = false;

    // Light enters, on the average over the hemisphere, nearly as at cosine 1/2.
    static VR_HD S albedo(const Parameters& p, const View& view) {
        return p.reflectance * entering(view, F(0.5f));
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V, V, F cos_i,
                            LobePart<F> part) {
        const F pdf = cosine_hemisphere_pdf_sa(cos_i);
        return {p.reflectance * pdf * (entering(view, cos_i) * part.share), pdf * part.chance};
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V, Numbers r, F, M nobody) {
        F cos_i;
        Sample s = cosine_lobe(view, r.u, r.v, cos_i, nobody);
        s.weight = p.reflectance * entering(view, cos_i);
        return s;
    }
};

template <class L>
struct Plastic : LobeSum<L, Coat<L>, CoatedBase<L, SmoothInterface<L>>> {
    static constexpr const char* kName = "plastic";
    static constexpr bool kIndexed = true;
    static constexpr uint32_t kReads = parameter_bit(kParameter_reflectance) |
                                       parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_eta);
};

}  // namespace veriray
