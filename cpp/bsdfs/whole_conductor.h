// A rough metal that loses nothing but what it absorbs: its mirrors, and a lobe for the light that
// meets several of them.
#pragma once

#include "bsdfs/lost_light.h"
#include "bsdfs/rough_conductor.h"
#include "bsdfs/sum.h"

namespace veriray {

// Chosen by what mirrors that reflect all send on.
template <class L>
struct MirroredOnce : RoughConductor<L> {
    VR_CLOSURE(L);
    using U = typename L::U;
    static constexpr bool kDelta = false;

    static VR_HD LobePart<F> part(const Parameters& p, const View& view) {
        const F share = F(1.f) - LostLight<L>::lost(p, view, view.cos_o, U(kLostAtCosine));
        return {share, share};
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i,
                            LobePart<F> part) {
        const Value one = RoughConductor<L>::eval(p, view, wo, wi, cos_i);
        return {one.f_cos, one.pdf_sa * part.chance};
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, F chance,
                               M nobody) {
        r.lobe = min(r.lobe / chance, F(1.f));
        return RoughConductor<L>::sample(p, view, wo, r, nobody);
    }
};

template <class L>
struct MirroredAgain : LostLight<L> {
    VR_CLOSURE(L);
    using U = typename L::U;
    using LostLight<L>::lost, LostLight<L>::pdf_sa, LostLight<L>::direction;
    static constexpr bool kDelta = false;

    // Of all further reflections, by the mean F of one and the share E that leaves after each:
    // F^2 E / (1 - F (1 - E)).
    static VR_HD S albedo(const Parameters& p, const View& view) {
        const F mean = view.table.number(U(kLostMean));
        return S::of([&](uint32_t k) {
            const F once = p.specular_reflectance[k] * view.table.number(U(kReflectedMean + k));
            return once * once * (F(1.f) - mean) / fma(-mean, once, F(1.f));
        });
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V, V, F cos_i,
                            LobePart<F> part) {
        const U first(kLostAtCosine);
        const F both = lost(p, view, view.cos_o, first) * lost(p, view, cos_i, first);
        const F even = cosine_hemisphere_pdf_sa(cos_i) / view.table.number(U(kLostMean));
        return {albedo(p, view) * (both * even), pdf_sa(p, cos_i) * part.chance};
    }
    // The sum of lobes weighs it.
    static VR_HD Sample sample(const Parameters& p, const View& view, V, Numbers r, F, M nobody) {
        F cosine;
        const V wi = direction(p, view, r.u, r.v, cosine);
        return {wi, S::all(F(0.f)), pdf_sa(p, cosine), nobody, nobody};
    }
};

template <class L>
struct WholeConductor : LobeSum<L, MirroredOnce<L>, MirroredAgain<L>> {
    static constexpr const char* kName = "roughconductor_whole";
    static constexpr bool kThirdNumber = true;
    static constexpr uint32_t kTable = kLostAtCosine + kLostCells + 1;
    static constexpr uint32_t kReads = RoughConductor<L>::kReads;
};

}  // namespace veriray
