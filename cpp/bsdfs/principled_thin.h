// A thin principled sheet: diffuse parts with sheen on the side of the light and behind it, and
// mirrors that reflect or let light through to behind as if they reflected it there. Both sides are
// alike. B. Burley, "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering",
// SIGGRAPH 2015, section 5; the numbers are Mitsuba 3's.
#pragma once

#include "bsdfs/principled_parts.h"

namespace veriray {

template <class L>
struct PrincipledThin : PrincipledParts<L> {
    VR_CLOSURE(L);
    using typename PrincipledParts<L>::Facets;
    using PrincipledParts<L>::grazing, PrincipledParts<L>::tinted, PrincipledParts<L>::mirrors;
    using PrincipledParts<L>::matt;
    static constexpr const char* kName = "principledthin";
    static constexpr bool kScatters = true, kTransmits = true, kRefracts = true, kIndexed = true;
    static constexpr uint32_t kReads =
        parameter_bit(kParameter_reflectance) | parameter_bit(kParameter_eta) |
        parameter_bit(kParameter_roughness) | parameter_bit(kParameter_spec_trans) |
        parameter_bit(kParameter_spec_tint) | parameter_bit(kParameter_sheen) |
        parameter_bit(kParameter_sheen_tint) | parameter_bit(kParameter_flatness) |
        parameter_bit(kParameter_anisotropic) | parameter_bit(kParameter_diff_trans);

    // Of what is beyond the sheet, which compresses no light. Its mirrors have eta.
    static VR_HD F index(const Parameters&, M) { return F(1.f); }
    // Nearly: without tints and sheen.
    static VR_HD S albedo(const Parameters& p, const View& view) {
        const F r = fresnel_dielectric(min(view.cos_o, F(1.f)), p.eta[0]).reflected;
        const F mirror = p.spec_trans * r;
        return p.reflectance * (F(1.f) - mirror) + S::all(mirror);
    }

    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i) {
        const F one(1.f), none(0.f);
        const M up = cos_i > none;
        const Facets facets = sheet(p, view, up);
        const V o = facets.local(wo, view.cos_o), i = facets.local(wi, cos_i);
        const V j{i.x, i.y, abs(i.z)};  // where wi would be on wo's side
        const V h = o + j;
        const F length = sqrt(dot(h, h)), om = F(0.5f) * length;
        const V m = h * (one / length);
        const FresnelSplit<F> split = fresnel_dielectric(min(om, one), p.eta[0]);
        const F r = split.reflected;
        const F slant = grazing(select(p.eta[0] > one, om, split.cos_t));
        const F turned = (p.eta[0] - one) / (p.eta[0] + one), dark = turned * turned;

        const F d = F(0.25f) * facets.density(m) * facets.seen(o);
        const F lit = d * facets.seen(j) * j.z * p.spec_trans;
        // Behind, those mirrors send light that have wi behind them, too.
        const F beyond = select(dot(i, h) < none, lit * (one - r), none);
        const Halves half = halves(p);
        const F even = cosine_hemisphere_pdf_sa(j.z);
        const F diffuse = half.up * even * matt(p, view.cos_o, j.z, om);
        const F sheen = half.up * p.sheen * grazing(om) * j.z;
        const S tint = tinted(p);
        const S value = S::of([&](uint32_t k) {
            const F clear =
                fma(p.spec_tint, mix(tint[k] * dark, one, slant), (one - p.spec_tint) * r);
            const F veil = sheen * mix(one, tint[k], p.sheen_tint);
            const F above = fma(lit, clear, fma(p.reflectance[k], diffuse, veil));
            return select(up, above, p.reflectance[k] * fma(half.down, even, beyond));
        });
        const Shares chosen = shares(p, view);
        const F matt_share = select(up, chosen.up, chosen.down);
        return {value, fma(matt_share, even, select(up, chosen.mirror, chosen.through) * d)};
    }

    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        const F one(1.f), none(0.f);
        const Shares chosen = shares(p, view);
        const F matt_share = chosen.up + chosen.down;
        const M diffuse = r.lobe < matt_share;
        const M behind = (diffuse & !(r.lobe < chosen.up)) |
                         ((!diffuse) & !(r.lobe < matt_share + chosen.mirror));
        const Facets facets = sheet(p, view, !behind);
        const V o = facets.local(wo, view.cos_o), m = facets.draw(o, r.u, r.v, r.lobe);
        V i = select(diffuse, cosine_hemisphere(r.u, r.v), reflected(o, m, dot(o, m)));
        i.z = select(behind, -i.z, i.z);
        const V wi = facets.world(i);
        const F cos_i = dot(view.n, wi);
        const Value found = eval(p, view, wo, wi, cos_i);
        const M right = (select(behind, -cos_i, cos_i) > none) & (found.pdf_sa > none);
        return {wi, select(right, found.f_cos * (one / found.pdf_sa), S::all(none)),
                select(right, found.pdf_sa, none), behind, nobody};
    }

   private:
    // The mirrors of those that reflect (up), or of those that let light through, whose slopes are
    // as wide as refraction at both sides makes them.
    static VR_HD Facets sheet(const Parameters& p, const View& view, M up) {
        const F wide = fma(F(0.65f), p.eta[0], F(-0.35f));
        return mirrors(p, view, select(up, p.roughness, p.roughness * wide));
    }
    // Shares of the diffuse light on wo's side and behind.
    struct Halves {
        F up, down;
    };
    static VR_HD Halves halves(const Parameters& p) {
        const F shut = F(1.f) - p.spec_trans, down = F(0.5f) * p.diff_trans;
        return {shut * (F(1.f) - down), shut * down};
    }
    // The chances of the lobes: about what they send, and positive where that is.
    struct Shares {
        F up, down, mirror, through;
    };
    static VR_HD Shares shares(const Parameters& p, const View& view) {
        const F one(1.f), none(0.f), least(0.0625f);
        const F r = fresnel_dielectric(min(view.cos_o, one), p.eta[0]).reflected;
        const F most = max_channel(p.reflectance);
        const Halves half = halves(p);
        const F up = half.up * fma(F(0.25f), p.sheen, most), down = half.down * most;
        const M dull = (p.eta[0] == one) & !(p.spec_tint > none);
        const F mirror = select(dull, none, p.spec_trans * max(r, least));
        const F through = p.spec_trans * max(one - r, least) * most;
        const F total = (up + down) + (mirror + through);
        const F scale = select(total > none, one / total, none);
        return {up * scale, down * scale, mirror * scale, through * scale};
    }
};

}  // namespace veriray
