// Rough interfaces: sheets of small mirrors, whose normals m are spread about n. Directions are
// local: n = +z. B. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR
// 2007; shadowing by Smith's functions: separable, as Mitsuba 3 has it, or correlated by height.
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
    // Whose heights count (slopes_number).
    static VR_HD M correlated(const MaterialParameters<F>& p) {
        return abs(p.distribution) > F(1.f);
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

    // Smith's G2 over the product of both G1, a and b, for directions on one side: 1 if it is
    // separable. Correlated by height, G2 = 1 / (1 + Lambda_o + Lambda_i), G1 = 1 / (1 + Lambda).
    // E. Heitz, "Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs", JCGT
    // 3(2), 2014.
    static VR_HD F in_common(M correlated, F a, F b) {
        const F one(1.f);
        if (none(correlated)) return one;
        return select(correlated, one / fma(b, one - a, a), one);
    }
    // Likewise, and for directions on both sides where `mirror` is not set. A height that wo sees
    // by the chance h^Lambda_o is open to the other side by (1 - h)^Lambda_i, so that G2 is Euler's
    // beta function B(1 + Lambda_o, 1 + Lambda_i): E. Heitz et al., "Multiple-Scattering
    // Microfacet BSDFs with the Smith Model", SIGGRAPH 2016. By Stirling's series for large
    // numbers, whose rest is fitted within 9e-8 for those from 1 on.
    static VR_HD F in_common(M correlated, F a, F b, M mirror) {
        const F one(1.f);
        if (none(correlated)) return one;
        return select(correlated, select(mirror, one / fma(b, one - a, a), open_both_ways(a, b)),
                      one);
    }
    static VR_ONCE F open_both_ways(F a, F b) {
        const F one(1.f), sum = a + b, over = one / sum,
                          most(0.125f);  // above the sum of the rests
        const F falls =
            most - (rest(a) + rest(b) - rest(a * b * over)) -
            fma((one - a) / a, log_of_share(b, a, over), (one - b) / b * log_of_share(a, b, over));
        const F root_2_pi(2.5066283f * 1.1331485f);  // times e^most
        return root_2_pi * exp_minus(falls) * over * sqrt(over);
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

   private:
    // ln(x / (x + y)), accurate where that is almost 1; over: 1 / (x + y).
    static VR_HD F log_of_share(F x, F y, F over) {
        return select(y < F(0.25f) * x, log_of_parts(-(y * over), F(0.f)), log(x * over));
    }
    // ln(x!) - (x + 1/2) ln x + x - ln(2 pi) / 2 for x = 1 / w, w in [0, 1].
    static VR_HD F rest(F w) {
        constexpr float c[] = {8.33332043e-2f, -2.77048576e-3f, 7.22026465e-4f, -3.00266983e-4f,
                               7.70738280e-5f};
        return w * polynomial(w * w, c);
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
        const F lit = facets.seen(i);
        const F both = Facets::in_common(Facets::correlated(p), masking * o.z, lit * cos_i);
        return {d * masking * lit * cos_i * both, d * facets.drawn(o, m, masking), dot(o, m)};
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
        const F lit = facets.seen(i) * i.z;
        const F both = Facets::in_common(Facets::correlated(p), masking * o.z, lit);
        const F up = lit * masking / chance * both;
        return {facets.world(i), select(i.z > F(0.f), up, F(0.f)),
                F(0.25f) * facets.density(m) * chance, c};
    }
};

}  // namespace veriray
