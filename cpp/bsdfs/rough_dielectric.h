// A rough interface of two media: small mirrors that reflect or refract, chosen by Fresnel's
// reflectance. B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR
// 2007.
#pragma once

#include "bsdfs/microfacet.h"

namespace veriray {

template <class L>
struct RoughDielectric : Closure<L> {
    VR_CLOSURE(L);
    using Facets = Microfacets<L>;
    static constexpr const char* kName = "roughdielectric";
    static constexpr bool kScatters = true, kTransmits = true, kRefracts = true, kIndexed = true;
    static constexpr uint32_t kReads = parameter_bit(kParameter_specular_reflectance) |
                                       parameter_bit(kParameter_specular_transmittance) |
                                       parameter_bit(kParameter_eta) | kReadsRoughness;

    // eta is inside (behind the front) over outside.
    static VR_HD F index(const Parameters& p, M from_front) {
        return select(from_front, p.eta[0], F(1.f) / p.eta[0]);
    }
    // Nearly: that of the smooth interface.
    static VR_HD S albedo(const Parameters& p, const View& view) {
        const F r = view.fresnel.reflected;
        return p.specular_reflectance * r + p.specular_transmittance * (F(1.f) - r);
    }
    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i) {
        const Facets facets = Facets::of(p, view);
        const V o = facets.local(wo, view.cos_o), i = facets.local(wi, cos_i);
        const M mirror = cos_i > F(0.f);
        // along the normal of the mirrors that send wo to wi
        const V h = fma(i, select(mirror, F(1.f), view.relative), o);
        const F h2 = dot(h, h);
        const V m = h * (select(h.z < F(0.f), F(-1.f), F(1.f)) / sqrt(h2));
        const F om = dot(o, m), im = dot(i, m);
        // Behind, there is one only if it has wo in front and wi behind.
        const M sent = mirror | ((om > F(0.f)) & (im < F(0.f)));
        const F r = fresnel_of_mirror(om, im, view.relative, !mirror).reflected;
        // dm / dwi: 1 / (4 wo.m), or the squared index times that
        const F spread = select(mirror, F(0.25f) * r, (F(1.f) - r) * abs(om * im) / h2);
        const F d = facets.density(m) * select(sent, spread, F(0.f));
        const F masking = facets.seen(o), lit = facets.seen(i) * abs(cos_i);
        const S colour = select(mirror, p.specular_reflectance,
                                p.specular_transmittance * (squared(view) * compression(view)));
        const F both = Facets::in_common(Facets::correlated(p), masking * o.z, lit, mirror);
        return {colour * (d * masking * lit * both),
                d * facets.drawn(o, m, masking) * select(mirror, F(1.f), squared(view))};
    }

    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        const Facets facets = Facets::of(p, view);
        const V o = facets.local(wo, view.cos_o), m = facets.draw(o, r.u, r.v, r.lobe);
        const F om = dot(o, m);
        const FresnelSplit<F> split = fresnel_dielectric(min(om, F(1.f)), view.relative);
        const M mirror = (r.lobe < split.reflected) | !(split.cos_t > F(0.f));
        const V i =
            select(mirror, reflected(o, m, om), refracted(o, m, om, split.cos_t, view.relative));
        const F masking = facets.seen(o), chance = facets.drawn(o, m, masking);
        const F up = select(mirror, i.z, -i.z);
        const F lit = facets.seen(i) * up;
        const F both = Facets::in_common(Facets::correlated(p), masking * o.z, lit, mirror);
        const F share = select(up > F(0.f), lit * masking / chance * both, F(0.f));
        const F across = fma(-view.relative, split.cos_t, om);
        const F through = (F(1.f) - split.reflected) * om * split.cos_t / (across * across);
        const F spread = select(mirror, F(0.25f) * split.reflected, through * squared(view));
        const S colour =
            select(mirror, p.specular_reflectance, p.specular_transmittance * compression(view));
        return {facets.world(i), colour * share, facets.density(m) * chance * spread, !mirror,
                nobody};
    }

   protected:
    static VR_HD F squared(const View& view) { return view.relative * view.relative; }
    // Refraction scales radiance as it compresses the solid angle.
    static VR_HD F compression(const View& view) {
        if (view.transport == Transport::kImportance) return F(1.f);
        return F(1.f) / squared(view);
    }
};

}  // namespace veriray
