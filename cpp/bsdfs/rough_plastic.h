// A diffuse base within a rough coat: mirrors of the coat or base, selected by what they reflect.
#pragma once

#include "bsdfs/microfacet.h"
#include "bsdfs/plastic.h"

namespace veriray {

template <class L>
struct RoughCoat : RoughMirror<L> {
    VR_CLOSURE(L);
    using RoughMirror<L>::lobe, RoughMirror<L>::drawn;
    static constexpr bool kDelta = false;

    static VR_HD LobePart<F> part(const Parameters& p, const View& view) {
        return part_of_coat(p, F(1.f) - view.table.transmittance(view.cos_o));
    }
    static VR_HD F reflectance(const View& view, F cosine) {
        return fresnel_dielectric(min(cosine, F(1.f)), view.relative).reflected;
    }
    static VR_HD S albedo(const Parameters& p, const View&) { return p.specular_reflectance; }
    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i,
                            LobePart<F> part) {
        const auto one = lobe(p, view, wo, wi, cos_i);
        return {p.specular_reflectance * (one.f_cos * reflectance(view, one.cosine)),
                one.pdf_sa * part.chance};
    }
    // The sum weighs it, unless it goes below the horizon.
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, F chance,
                               M nobody) {
        r.lobe = min(r.lobe / chance, F(1.f));
        const auto one = drawn(p, view, wo, r);
        return {one.wi, S::all(F(0.f)), one.pdf_sa, nobody, nobody};
    }
};

template <class L>
struct RoughInterface : Closure<L> {
    VR_CLOSURE(L);
    static VR_HD F entering(const View& view, F cos_i) { return view.table.transmittance(cos_i); }
};

template <class L>
struct RoughPlastic : LobeSum<L, RoughCoat<L>, CoatedBase<L, RoughInterface<L>>> {
    static constexpr const char* kName = "roughplastic";
    static constexpr bool kIndexed = true;
    static constexpr uint32_t kTable = kCoatCells + 1;
    static constexpr uint32_t kReads = parameter_bit(kParameter_reflectance) |
                                       parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_eta) | kReadsRoughness;
};

}  // namespace veriray
