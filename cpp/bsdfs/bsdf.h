// A surface's material, one per lane: its closure, its parameters and the view along wo.
#pragma once

#include "bsdfs/called.h"
#include "bsdfs/relief.h"

namespace veriray {

// kKinds: the kinds that can occur.
template <class L, uint32_t kKinds>
struct Bsdf {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    static constexpr bool has(uint32_t kinds) { return (kKinds & kinds) != 0; }
    static constexpr bool kOneKind = (kKinds & (kKinds - 1u)) == 0;
    static constexpr bool kChooses = has(kChoosingKinds);  // selects between lobes
    static constexpr bool kEitherSide = has(kEitherSideKinds), kTransmits = has(kTransmittingKinds),
                          kClear = has(kClearKinds) || kTransmits;
    // Kinds that a scene does without are not looked for at run time.
    static constexpr bool kFew = std::is_same_v<F, float> || kOneKind;
    // Parameters that some of the kinds read.
    static constexpr bool reads(ParameterBit p) {
        for (uint32_t k = 0; k < kMaterialCount; ++k)
            if (has(1u << k) && (kClosures[k].reads & parameter_bit(p))) return true;
        return false;
    }

    U kind;
    MaterialParameters<F> parameters;
    ClosureView<L> view;
    uint32_t present = kKinds;  // the scene's kinds
    Relief<L> relief;

    VR_HD M is(uint32_t which) const { return kind == U(which); }
    VR_HD M nobody() const { return kind == U(kMaterialCount); }

    // Kinds whose code is skipped where no lane has them (cpp/README.md, "Code of rare kinds").
    static constexpr uint32_t kRare = kAllKinds & ~kPlainKinds;
    template <uint32_t kWanted>
    VR_HD bool occurs() const {
        return kOneKind || any(any_of<kWanted>());
    }

    // Calls visit(closure, lanes that have it) for the kinds of kWanted that can occur.
    template <uint32_t kWanted = kAllKinds, class Visit>
    VR_HD void each(Visit visit) const {
#define VR_VISIT(C)                                      \
    if constexpr (has(kWanted & kind_bit(kKind##C)))     \
        if (kFew || (present & kind_bit(kKind##C)) != 0) \
            visit(UsedClosure<kKind##C, C<L>>(), kOneKind ? !nobody() : is(kKind##C));
        VR_CLOSURES(VR_VISIT)
#undef VR_VISIT
    }
    // Lanes of those kinds.
    template <uint32_t kWanted>
    VR_HD M any_of() const {
        M found = nobody();
        each<kWanted>([&](auto, M m) { found = found | m; });
        return found;
    }

    // Lobes let light through.
    VR_HD M clear() const { return any_of<kClearKinds | kTransmittingKinds>(); }
    VR_HD M scatters() const { return any_of<kScattering>(); }          // light samples reach it
    VR_HD M transmits() const { return any_of<kTransmittingKinds>(); }  // from behind, too
    VR_HD M either_side() const { return any_of<kEitherSideKinds>(); }
    // Smooth glass of a mesh that is round there: its normals are within 45 degrees.
    VR_HD M refracts_as_round(V ns, V ng) const {
        return any_of<kClearKinds & kRefracting>() & (dot(ns, ng) > F(0.7071068f));
    }
    VR_HD M only_passes() const { return any_of<kAllKinds & ~kReflecting>(); }
    VR_HD M black() const {
        M found = nobody();
        each([&](auto closure, M m) { found = found | (m & closure.black(parameters, nobody())); });
        return found;
    }

    // cosine: between wo and n; from_front: wo is in front of the surface.
    VR_HD void set_view(V n, F cosine, M from_front) {
        view.n = n;
        view.cos_o = cosine;
        if constexpr (has(kIndexedKinds)) {
            view.relative = parameters.eta[0], view.fresnel = {F(0.f), F(0.f)};
            if (!occurs<kIndexedKinds>()) return;
            each<kIndexedKinds>([&](auto closure, M m) {
                view.relative = select(m, closure.index(parameters, from_front), view.relative);
            });
            const FresnelSplit<F> one = fresnel_dielectric(min(cosine, F(1.f)), view.relative);
            view.fresnel = one;
            each<kIndexedKinds>([&](auto closure, M m) {
                view.fresnel.reflected =
                    select(m, closure.split(one).reflected, view.fresnel.reflected);
            });
        }
    }

    // Non-delta lobes for light from wi on wo's side, or behind where they transmit; cos_i: between
    // wi and n, positive on wo's side.
    VR_HD BsdfValue<F> eval(V wo, V wi, F cos_i) const {
        BsdfValue<F> value{S::all(F(0.f)), F(0.f)};
        const auto take = [&](auto closure, M m) {
            const BsdfValue<F> one = closure.eval(parameters, view, wo, wi, cos_i);
            value.f_cos = kOneKind ? one.f_cos : select(m, one.f_cos, value.f_cos);
            value.pdf_sa = kOneKind ? one.pdf_sa : select(m, one.pdf_sa, value.pdf_sa);
        };
        each<kScattering & ~kRare>(take);
        each<kScattering & kRare>([&](auto closure, M m) {
            if (kOneKind || any(m)) take(closure, m);
        });
        if (relief.some) {
            const F lit = relief.lit(wi, cos_i);
            value.f_cos = select(lit > F(0.f), value.f_cos * lit, S::all(F(0.f)));
            value.pdf_sa = select(lit > F(0.f), value.pdf_sa, F(0.f));
        }
        return value;
    }

    // Density of sampling wo from wi, both on the side of n; non-delta lobes. cos_o, cos_i:
    // positive.
    VR_HD F reverse_pdf(V wo, V wi, F cos_o, F cos_i, M from_front) const {
        Bsdf back = *this;
        back.set_view(view.n, cos_i, from_front);
        return back.eval(wi, wo, cos_o).pdf_sa;
    }

    // Share of the light from wo that goes on; see the closures.
    VR_HD S albedo() const {
        S share = S::all(F(0.f));
        each([&](auto closure, M m) {
            if (kOneKind || any(m)) share = select(m, closure.albedo(parameters, view), share);
        });
        return share;
    }

    VR_HD BsdfSample<L> sample(V wo, BsdfNumbers<F> r) const {
        BsdfSample<L> s = sample_closure(wo, r);
        if (relief.some) {  // light that goes straight through is left as it is
            const F lit = select(s.pass, F(1.f), relief.lit(s.wi, dot(view.n, s.wi)));
            s.weight = select(lit > F(0.f), s.weight * lit, S::all(F(0.f)));
            s.pdf_sa = select(lit > F(0.f), s.pdf_sa, F(0.f));
        }
        return s;
    }
    VR_HD BsdfSample<L> sample_closure(V wo, BsdfNumbers<F> r) const {
        const F zero(0.f);
        BsdfSample<L> s{{zero, zero, zero}, S::all(zero), zero, nobody(), nobody()};
        each<~kRare>([&](auto closure, M) {  // the other kinds' lanes are set below
            s = closure.sample(parameters, view, wo, r, nobody());
        });
        if (!occurs<kRare>()) return s;
        each<kRare>([&](auto closure, M m) {
            if (kOneKind || any(m)) {
                const BsdfSample<L> one = closure.sample(parameters, view, wo, r, nobody());
                s = kOneKind ? one : Closure<L>::chosen(m, one, s);
            }
        });
        return s;
    }

    // Directions on the wrong side of a smooth surface: black; of clear lanes along the face, 2^-10
    // above it, if the mesh is round, or else the same lobe, or the mirror it leaves, about ng.
    VR_HD void sample_flat(BsdfSample<L>& s, V wo, V ng, M from_front, M wrong) const {
        BsdfSample<L> along = s;
        s.weight = select(wrong, S::all(F(0.f)), s.weight);
        if constexpr (has(kClearKinds & kReflecting)) {
            wrong = wrong & any_of<kClearKinds>() & (max_channel(along.weight) > F(0.f));
            if (none(wrong)) return;
            const M round = refracts_as_round(view.n, ng);
            Bsdf flat = *this;
            flat.set_view(ng, dot(ng, wo), from_front);
            each<kClearKinds & kReflecting>([&](auto closure, M m) {
                const M through = s.transmitted & (flat.view.fresnel.cos_t > F(0.f));
                const BsdfSample<L> one =
                    closure.sample_again(parameters, flat.view, wo, m & through);
                s = Closure<L>::chosen(wrong & m & !round, one, s);
            });
            const F rise = select(s.transmitted, F(-0x1p-10f), F(0x1p-10f)) - dot(ng, along.wi);
            along.wi = fma(ng, rise, along.wi);
            along.wi = along.wi * (F(1.f) / sqrt(dot(along.wi, along.wi)));
            s = Closure<L>::chosen(wrong & round, along, s);
        }
    }

    // Share of light that goes straight through.
    VR_HD S pass_through() const {
        S share = S::all(F(0.f));
        each<kPassing>([&](auto closure, M m) {
            share = select(m, closure.pass_through(parameters, view), share);
        });
        return share;
    }
};

}  // namespace veriray
