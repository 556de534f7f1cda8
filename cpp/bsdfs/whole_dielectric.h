// A rough interface of two media that loses no light: its mirrors, and lobes on both sides for the
// light that meets several of them, which is split between the sides so that f stays reciprocal
// (scene/lost_light.h).
#pragma once

#include "bsdfs/lost_light.h"
#include "bsdfs/rough_dielectric.h"

namespace veriray {

template <class L>
struct WholeDielectric : RoughDielectric<L> {
    VR_CLOSURE(L);
    using U = typename L::U;
    using Once = RoughDielectric<L>;
    using Again = LostLight<L>;
    static constexpr const char* kName = "roughdielectric_whole";
    static constexpr uint32_t kTable = kLostBehind + kLostCells + 1;

    static VR_HD S albedo(const Parameters& p, const View& view) {
        const Lost here = Lost::of(p, view);
        const S again = p.specular_reflectance * (F(1.f) - here.through) +
                        p.specular_transmittance * here.through;
        return Once::albedo(p, view) * (F(1.f) - here.at_wo) + again * here.at_wo;
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i) {
        const Lost here = Lost::of(p, view);
        const Value once = Once::eval(p, view, wo, wi, cos_i);
        const F c = abs(cos_i);
        const M up = cos_i > F(0.f);
        const M front = (here.front & up) | !(here.front | up);  // of wi
        const F share = here.at_wo * select(up, F(1.f) - here.through, here.through);
        const F even = cosine_hemisphere_pdf_sa(c) * Again::lost(p, view, c, first(front)) /
                       view.table.number(select(front, U(kLostMean), U(kLostMeanBehind)));
        const S colour =
            select(up, p.specular_reflectance, p.specular_transmittance * Once::compression(view));
        return {once.f_cos + colour * (share * even),
                fma(once.pdf_sa, F(1.f) - here.at_wo, share * Again::pdf_sa(p, c))};
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        const Lost here = Lost::of(p, view);
        const F one(1.f), kept = one - here.at_wo;
        const M first_step = r.lobe < kept;
        const F rest = (r.lobe - kept) / here.at_wo;
        Numbers of_once = r;
        of_once.lobe = min(r.lobe / kept, one);
        Sample s = Once::sample(p, view, wo, of_once, nobody);
        F cosine;
        const V up = Again::direction(p, view, r.u, r.v, cosine);
        const M across = rest < here.through;
        const V wi = select(across, fma(view.n, F(-2.f) * cosine, up), up);
        s.wi = select(first_step, s.wi, wi);
        s.transmitted = (first_step & s.transmitted) | (!first_step & across);
        const F cos_i = dot(view.n, s.wi);
        const Value all = eval(p, view, wo, s.wi, cos_i);
        // what a mirror sends to the other side than it should is lost
        const M right = select(s.transmitted, -cos_i, cos_i) > F(0.f);
        s.weight = select(right, all.f_cos * (one / all.pdf_sa), S::all(F(0.f)));
        s.pdf_sa = select(right, all.pdf_sa, s.pdf_sa * kept);
        return s;
    }

   private:
    static VR_HD U first(M front) { return select(front, U(kLostAtCosine), U(kLostBehind)); }
    struct Lost {
        M front;  // of wo: indices differ, so that the one beyond tells
        F at_wo, through;

        static VR_HD Lost of(const Parameters& p, const View& view) {
            const M front = view.relative == p.eta[0];
            return {front, Again::lost(p, view, view.cos_o, first(front)),
                    view.table.number(select(front, U(kThrough), U(kThroughBehind)))};
        }
    };
};

}  // namespace veriray
