// Rough interfaces: sheets of small mirrors, whose normals m are spread about n. Directions are
// local: n = +z. B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR
// 2007; shadowing by Smith's separable function, as Mitsuba 3 has it.
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

// Rough surfaces read these.
inline constexpr uint32_t kReadsRoughness = parameter_bit(kParameter_alpha_u) |
                                            parameter_bit(kParameter_alpha_v) |
                                            parameter_bit(kParameter_distribution);

template <class L>
struct Microfacets {
    using F = typename L::F;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    V a, b, n;  // the frame
    F alpha_u, alpha_v;
    M ggx;  // else Beckmann

    static VR_HD Microfacets of(const MaterialParameters<F>& p, const ClosureView<L>& view) {
        return of(view, p.alpha_u, p.alpha_v, p.distribution > F(0.f));
    }
    static VR_HD Microfacets of(const ClosureView<L>& view, F alpha_u, F alpha_v, M ggx) {
        Microfacets f;
        f.n = view.n;
        orthonormal_frame(f.n, f.a, f.b);
        f.alpha_u = alpha_u, f.alpha_v = alpha_v, f.ggx = ggx;
        if (view.tangents) {
            const M turned = !(alpha_u == alpha_v);
            f.a = select(turned, view.tangent, f.a);
            f.b = select(turned, cross(f.n, view.tangent), f.b);
        }
        return f;
    }
    VR_HD V local(V w, F cosine) const { return {dot(a, w), dot(b, w), cosine}; }
    VR_HD V world(V w) const { return renormalised(fma(a, w.x, fma(b, w.y, n * w.z))); }

    // D: area of the mirrors of normal m, per area of the surface and solid angle.
    VR_HD F density(V m) const { return density_of(m.x, m.y, m.z, alpha_u, alpha_v, ggx); }
    static VR_ONCE F density_of(F mx, F my, F mz, F alpha_u, F alpha_v, M ggx) {
        const F x = mx / alpha_u, y = my / alpha_v, z2 = mz * mz;
        const F slope2 = fma(x, x, y * y);
        const F q = slope2 + z2;
        const F falls = exp_minus(slope2 / z2);  // 0 where z2 is
        const F beckmann = select(falls > F(0.f), falls / (z2 * z2), F(0.f));
        return select(ggx, F(1.f) / (q * q), beckmann) * (F(kInvPi) / (alpha_u * alpha_v));
    }

    // Smith's G1 over the cosine: the share of the mirrors' area seen along w, of either side, that
    // is not hidden. Beckmann's by Mitsuba's fraction, within 0.35 % of the exact one.
    VR_HD F seen(V w) const {
        const F x = alpha_u * w.x, y = alpha_v * w.y;
        return seen_of(abs(w.z), fma(x, x, y * y), ggx);
    }
    static VR_ONCE F seen_of(F c, F s2, M ggx) {
        const F s = sqrt(s2);
        const F smooth = F(2.f) / (c + sqrt(fma(c, c, s2)));
        const F over = fma(F(3.535f), s, F(2.181f) * c);
        const F under = fma(F(2.577f) * c, c, fma(F(2.276f) * s, c, s2));
        const F beckmann = select(c >= F(1.6f) * s, F(1.f) / c, over / under);
        return select(ggx, smooth, beckmann);
    }

    // The density of `draw` is D (wo.m) times this; `masking` is seen(wo). GGX: of the visible
    // normals. Beckmann: of all normals, each with its opposite slope, of which one is taken in
    // proportion to the area that wo sees of both.
    VR_HD F drawn(V wo, V m, F masking) const {
        const F tilt = abs(fma(wo.x, m.x, wo.y * m.y)) / m.z;
        return select(ggx, masking, F(1.f) / max(wo.z, F(0.5f) * (wo.z + tilt)));
    }
    // u, v, coin in [0, 1]; leaves in coin a number that m does not depend on. GGX by spherical
    // caps: J. Dupuy, A. Benyoub, HPG 2023.
    VR_HD V draw(V wo, F u, F v, F& coin) const {
        F sine, cosine;
        sincos_2pi(v, sine, cosine);
        V h{F(0.f), F(0.f), F(1.f)};
        if (any(ggx)) {
            const V stretched{alpha_u * wo.x, alpha_v * wo.y, wo.z};
            const V w = stretched * (F(1.f) / sqrt(dot(stretched, stretched)));
            const F up = F(1.f) + w.z, z = (F(1.f) - u) * up;  // of the cap's point, plus w.z
            const F r = sqrt(u * up * max((F(1.f) - w.z) + z, F(0.f)));
            h = {fma(r, cosine, w.x), fma(r, sine, w.y), z};
        }
        if (!any(!ggx)) return normal(h);
        const F r = sqrt(-log(F(1.f) - u)), x = r * cosine, y = r * sine;
        const F d = fma(alpha_u * wo.x, x, alpha_v * wo.y * y), none(0.f);
        const F one_way = max(wo.z + d, none), other = max(wo.z - d, none);
        const F at = coin * (one_way + other);
        const M first = (at < one_way) | !(other > none);
        coin = select(ggx, coin, select(first, at / one_way, (at - one_way) / other));
        const F sign = select(first, F(1.f), F(-1.f));
        return normal(select(ggx, h, V{x * sign, y * sign, F(1.f)}));
    }

    // Of a mirror whose normal would be along h if alpha were 1.
    VR_HD V normal(V h) const {
        const V m{alpha_u * h.x, alpha_v * h.y, h.z};
        return m * (F(1.f) / sqrt(dot(m, m)));
    }
};

// A lobe of the mirrors' reflections.
template <class L>
struct RoughMirror : Closure<L> {
    VR_CLOSURE(L);
    using Facets = Microfacets<L>;

    // f cos and density for reflection without the Fresnel factor; cosine: between wo and m.
    struct Lobe {
        F f_cos, pdf_sa, cosine;
    };
    static VR_HD Lobe lobe(const Parameters& p, const View& view, V wo, V wi, F cos_i) {
        const Facets facets = Facets::of(p, view);
        const V o = facets.local(wo, view.cos_o), i = facets.local(wi, cos_i);
        const V h = o + i, m = h * (F(1.f) / sqrt(dot(h, h)));
        const F d = F(0.25f) * facets.density(m), masking = facets.seen(o);
        return {d * masking * facets.seen(i) * cos_i, d * facets.drawn(o, m, masking), dot(o, m)};
    }
    // Reflects wo at a mirror; the weight is without the Fresnel factor, and 0 below the horizon.
    struct Drawn {
        V wi;
        F weight, pdf_sa, cosine;
    };
    static VR_HD Drawn drawn(const Parameters& p, const View& view, V wo, Numbers r) {
        const Facets facets = Facets::of(p, view);
        const V o = facets.local(wo, view.cos_o), m = facets.draw(o, r.u, r.v, r.lobe);
        const F c = dot(o, m), masking = facets.seen(o), chance = facets.drawn(o, m, masking);
        const V i = reflected(o, m, c);
        const F up = facets.seen(i) * i.z * masking / chance;
        return {facets.world(i), select(i.z > F(0.f), up, F(0.f)),
                F(0.25f) * facets.density(m) * chance, c};
    }
};

}  // namespace veriray
