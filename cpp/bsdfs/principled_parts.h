// What principled surfaces have in common. B. Burley, "Physically-Based Shading at Disney",
// SIGGRAPH 2012, and "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering",
// SIGGRAPH 2015; the numbers are Mitsuba 3's.
#pragma once

#include "bsdfs/clear_coat.h"
#include "bsdfs/microfacet.h"

namespace veriray {

template <class L>
struct PrincipledParts : Closure<L> {
    VR_CLOSURE(L);
    using Facets = Microfacets<L>;

    // Schlick's (1 - c)^5.
    static VR_HD F grazing(F c) {
        const F x = max(F(1.f) - c, F(0.f)), x2 = x * x;
        return x2 * x2 * x;
    }
    static VR_HD Facets mirrors(const Parameters& p, const View& view, F roughness) {
        const F slope = roughness * roughness, least(1e-3f);
        const F aspect = sqrt(fma(F(-0.9f), p.anisotropic, F(1.f)));
        return Facets::of(view, max(slope / aspect, least), max(slope * aspect, least),
                          aspect > F(0.f));
    }
    // The base colour at luminance 1; white for black.
    static VR_HD S tinted(const Parameters& p) {
        const S& c = p.reflectance;
        const F y = fma(F(0.212671f), c[0], fma(F(0.71516f), c[1], F(0.072169f) * c[2]));
        return select(y > F(0.f), c * (F(1.f) / y), S::all(F(1.f)));
    }
    // The diffuse part over that of Lambert, with the share that imitates scattering below the
    // surface. im: the cosine between wi and the normal of the mirrors that send it to wo.
    static VR_HD F matt(const Parameters& p, F cos_o, F cos_i, F im) {
        const F one(1.f), o5 = grazing(cos_o), i5 = grazing(cos_i);
        const F retro = F(2.f) * p.roughness * im * im, flat = F(0.5f) * retro;
        const F rough = fma(fma(F(-0.5f), o5, one), fma(F(-0.5f), i5, one),
                            retro * fma(o5 * i5, retro - one, o5 + i5));
        const F under = mix(one, flat, o5) * mix(one, flat, i5);
        const F soft = F(1.25f) * fma(under, one / (cos_o + cos_i) - F(0.5f), F(0.5f));
        return mix(rough, soft, p.flatness);
    }
};

}  // namespace veriray
