// The principled surface: a diffuse base with sheen, mirrors of metal or of a clear interface, and
// a clear coat; some of it may let light through. B. Burley, "Physically-Based Shading at Disney",
// SIGGRAPH 2012, and "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering",
// SIGGRAPH 2015; the numbers are Mitsuba 3's.
#pragma once

#include "bsdfs/clear_coat.h"
#include "bsdfs/principled_parts.h"

namespace veriray {

// kOpen: it lets light through, and is seen from behind. eta, inside over outside, is then not 1,
// so that it tells the sides.
template <class L, bool kOpen>
struct PrincipledLobes : PrincipledParts<L> {
    VR_CLOSURE(L);
    using typename PrincipledParts<L>::Facets;
    using PrincipledParts<L>::grazing, PrincipledParts<L>::tinted, PrincipledParts<L>::mirrors;
    using PrincipledParts<L>::matt;
    using Coat = ClearCoat<F>;
    static constexpr bool kScatters = true, kIndexed = true;
    static constexpr bool kTransmits = kOpen, kRefracts = kOpen;
    static constexpr uint32_t kReads =
        parameter_bit(kParameter_reflectance) | parameter_bit(kParameter_eta) |
        parameter_bit(kParameter_roughness) | parameter_bit(kParameter_metallic) |
        parameter_bit(kParameter_spec_trans) | parameter_bit(kParameter_spec_tint) |
        parameter_bit(kParameter_sheen) | parameter_bit(kParameter_sheen_tint) |
        parameter_bit(kParameter_flatness) | parameter_bit(kParameter_clearcoat) |
        parameter_bit(kParameter_clearcoat_gloss) | parameter_bit(kParameter_anisotropic);

    static VR_HD F index(const Parameters& p, M from_front) {
        return kOpen ? select(from_front, p.eta[0], F(1.f) / p.eta[0]) : p.eta[0];
    }
    // Nearly: without the tints of mirrors and sheen.
    static VR_HD S albedo(const Parameters& p, const View&) {
        const F open = opened(p);
        return S::of([&](uint32_t k) {
            return fma(open, sqrt(p.reflectance[k]), (F(1.f) - open) * p.reflectance[k]);
        });
    }

    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i) {
        const F one(1.f), none(0.f);
        const Facets facets = mirrors(p, view, p.roughness);
        const V o = facets.local(wo, view.cos_o), i = facets.local(wi, cos_i);
        const M up = kOpen ? cos_i > none : facets.ggx, front = in_front(p, view);
        const V h = fma(i, select(up, one, view.relative), o);
        const F h2 = dot(h, h), length = sqrt(h2);
        const V m = h * (select(h.z < none, F(-1.f), one) / length);
        F om = F(0.5f) * length, im = om;
        if constexpr (kOpen) om = select(up, om, dot(o, m)), im = select(up, im, dot(i, m));
        const FresnelSplit<F> split = kOpen ? fresnel_of_mirror(om, im, view.relative, !up)
                                            : fresnel_dielectric(min(om, one), view.relative);
        const F r = split.reflected;
        const F slant = grazing(select(view.relative > one, abs(om), split.cos_t));

        const F open = opened(p), shut = one - p.metallic;
        const F base = kOpen ? shut * (one - p.spec_trans) : shut;
        const S tint = tinted(p);
        const F turned = (view.relative - one) / (view.relative + one);
        const F dark = turned * turned;  // what the interface reflects at normal incidence
        F d = facets.density(m) * facets.seen(o);
        if constexpr (kOpen) d = select(up | ((om > none) & (im < none)), d, none);
        const F wide = kOpen ? select(up, F(0.25f), abs(om * im) * squared(view) / h2) : F(0.25f);
        const F lit = d * wide * facets.seen(i) * abs(cos_i);
        S value = S::of([&](uint32_t k) {
            const F c = p.reflectance[k], clear = fma(p.spec_tint, mix(tint[k] * dark, one, slant),
                                                      (one - p.spec_tint) * r);
            const F shine = fma(p.metallic, mix(c, one, slant), shut * clear);
            F share = select(r > none, shine, none);
            if constexpr (kOpen) {
                const F beyond = open * (one - r) * sqrt(c) * compression(view);
                share = select(up, select(front, share, open * r), beyond);
            }
            return share * lit;
        });
        const Shares<F> chosen = shares(p, view);
        F through(none);
        if constexpr (kOpen) through = refracts(p, front, r);
        F pdf = chosen.mirrors * d * wide * (kOpen ? select(up, one - through, through) : one);

        const F diffuse = base * F(kInvPi) * cos_i * matt(p, view.cos_o, cos_i, im);
        const F sheen = p.sheen * shut * grazing(im) * cos_i;
        const F coat = Coat::density(p.clearcoat_gloss, m);
        const F glint = F(0.25f) * p.clearcoat * mix(F(0.04f), one, slant) * coat *
                        Coat::seen(view.cos_o) * Coat::seen(cos_i) * cos_i;
        const M above = up & front;
        const auto only = [&](F x) { return kOpen ? select(above, x, none) : x; };
        for (uint32_t k = 0; k < kChannels; ++k) {
            const F veil = fma(sheen, mix(one, tint[k], p.sheen_tint), glint);
            value[k] = value[k] + only(fma(p.reflectance[k], diffuse, veil));
        }
        pdf = pdf + only(fma(chosen.diffuse, cosine_hemisphere_pdf_sa(cos_i),
                             chosen.coat * coat * m.z * F(0.25f) / im));
        return {value, pdf};
    }

    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        const F one(1.f), none(0.f);
        const Facets facets = mirrors(p, view, p.roughness);
        const Shares<F> chosen = shares(p, view);
        const F before = chosen.diffuse + chosen.coat;
        const M diffuse = r.lobe < chosen.diffuse, glossy = !(r.lobe < before);
        const F coin = (r.lobe - before) / chosen.mirrors;
        const V o = facets.local(wo, view.cos_o);
        const V m = select(glossy, facets.draw(o, r.u, r.v, r.lobe),
                           Coat::draw(p.clearcoat_gloss, r.u, r.v));
        const F om = dot(o, m);
        V i = reflected(o, m, om);
        M through = nobody;
        if constexpr (kOpen) {
            const FresnelSplit<F> split = fresnel_dielectric(min(abs(om), one), view.relative);
            through = glossy & (coin < refracts(p, in_front(p, view), split.reflected));
            i = select(through, refracted(o, m, om, split.cos_t, view.relative), i);
        }
        const V wi = facets.world(select(diffuse, cosine_hemisphere(r.u, r.v), i));
        const F cos_i = dot(view.n, wi);
        const Value found = eval(p, view, wo, wi, cos_i);
        const M right = (select(through, -cos_i, cos_i) > none) & (found.pdf_sa > none);
        return {wi, select(right, found.f_cos * (one / found.pdf_sa), S::all(none)),
                select(right, found.pdf_sa, none), through, nobody};
    }

   private:
    static VR_HD F squared(const View& view) { return view.relative * view.relative; }
    // Refraction scales radiance as it compresses the solid angle.
    static VR_HD F compression(const View& view) {
        if (view.transport == Transport::kImportance) return F(1.f);
        return F(1.f) / squared(view);
    }
    static VR_HD M in_front(const Parameters& p, const View& view) {
        return view.relative == p.eta[0];
    }
    static VR_HD F opened(const Parameters& p) {
        return kOpen ? (F(1.f) - p.metallic) * p.spec_trans : F(0.f);
    }

    // The chances of the lobes: about what they reflect and let through, and positive where that
    // is. From behind there are mirrors alone.
    template <class T>
    struct Shares {
        T diffuse, coat, mirrors;
    };
    static VR_HD Shares<F> shares(const Parameters& p, const View& view) {
        const F one(1.f), none(0.f), r = view.fresnel.reflected, open = opened(p);
        const F shut = one - p.metallic, base = kOpen ? shut * (one - p.spec_trans) : shut;
        const F most = max_channel(p.reflectance);
        F diffuse = fma(base, most, F(0.25f) * shut * p.sheen);
        F coat = F(0.25f) * p.clearcoat * mix(F(0.04f), one, grazing(view.cos_o));
        const F mirrors = fma(one - r, fma(p.metallic, most, open), max(r, F(0.0625f)));
        if constexpr (kOpen) {
            const M front = in_front(p, view);
            diffuse = select(front, diffuse, none), coat = select(front, coat, none);
        }
        const F some = select(view.relative == one, none, mirrors);
        const F total = diffuse + coat + some;
        const F scale = select(total > none, one / total, none);
        return {diffuse * scale, coat * scale, some * scale};
    }
    // Of mirrors of this reflectance: the chance of refraction.
    static VR_HD F refracts(const Parameters& p, M front, F r) {
        const F open = select(front, opened(p), F(1.f)), metal = select(front, p.metallic, F(0.f));
        const F through = open * (F(1.f) - r);
        return select(through > F(0.f), through / (through + mix(r, F(1.f), metal)), F(0.f));
    }
};

template <class L>
struct Principled : PrincipledLobes<L, false> {
    static constexpr const char* kName = "principled";
};

}  // namespace veriray
