// Closures made of several lobes, one of which is selected.
#pragma once

#include <utility>

#include "bsdfs/closure.h"

namespace veriray {

// f is the sum over the lobes of their share times their f. Shares sum to 1, and so do the chances
// of selection.
template <class F>
struct LobePart {
    F share, chance;
};

// A lobe has `part(parameters, view)`, which the last one is not asked for, kDelta, albedo,
// sample(parameters, view, wo, numbers, chance, nobody) and, unless it is a delta lobe,
// eval(parameters, view, wo, wi, cos_i, part), f times its share and the density times its chance.
// Where several lobes are not delta lobes, the one that is selected draws the direction and all of
// them weigh it (the balance heuristic for one sample: E. Veach, 1997, section 9.2.4).
template <class L, class... Lobes>
struct LobeSum : Closure<L> {
    VR_CLOSURE(L);
    static constexpr uint32_t kNonDelta = (0u + ... + (Lobes::kDelta ? 0u : 1u));
    static constexpr bool kScatters = kNonDelta > 0;

    // Calls visit(lobe, its part, sum of chances up to and with this one).
    template <class Visit>
    static VR_HD void each(const Parameters& p, const View& view, Visit visit) {
        LobePart<F> sum{F(0.f), F(0.f)};
        const auto one = [&]<bool kLast>(auto lobe) {
            LobePart<F> part{F(1.f) - sum.share, F(1.f) - sum.chance};
            if constexpr (!kLast) part = lobe.part(p, view);
            sum = {sum.share + part.share, sum.chance + part.chance};
            visit(lobe, part, sum.chance);
        };
        [&]<size_t... i>(std::index_sequence<i...>) {
            (one.template operator()<i + 1 == sizeof...(Lobes)>(Lobes()), ...);
        }(std::index_sequence_for<Lobes...>());
    }
    static VR_HD S albedo(const Parameters& p, const View& view) {
        S total = S::all(F(0.f));
        each(p, view, [&](auto lobe, LobePart<F> part, F) {
            total = fma(lobe.albedo(p, view), part.share, total);
        });
        return total;
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i) {
        Value total{S::all(F(0.f)), F(0.f)};
        bool first = true;
        each(p, view, [&](auto lobe, LobePart<F> part, F) {
            if constexpr (!decltype(lobe)::kDelta) {
                const Value one = lobe.eval(p, view, wo, wi, cos_i, part);
                total = first ? one : Value{total.f_cos + one.f_cos, total.pdf_sa + one.pdf_sa};
                first = false;
            }
        });
        return total;
    }
    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        Sample s{};
        M taken = nobody;
        each(p, view, [&](auto lobe, LobePart<F> part, F sum) {
            Sample one = lobe.sample(p, view, wo, r, part.chance, nobody);
            one.pdf_sa = one.pdf_sa * part.chance;
            if constexpr (kNonDelta == 1) one.weight = one.weight * (part.share / part.chance);
            s = chosen(taken, s, one);
            taken = taken | (r.lobe < sum);
        });
        if constexpr (kNonDelta > 1) {
            const F cos_i = dot(view.n, s.wi);
            const Value all = eval(p, view, wo, s.wi, cos_i);
            const M drawn = (s.pdf_sa > F(0.f)) & (cos_i > F(0.f));
            s.weight = select(drawn, all.f_cos * (F(1.f) / all.pdf_sa), s.weight);
            s.pdf_sa = select(drawn, all.pdf_sa, s.pdf_sa);
        }
        return s;
    }
};

}  // namespace veriray
