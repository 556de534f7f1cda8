// The closed list of materials. A new one: a kind, its branch in Bsdf, the Python factory and a
// test case.
//
// A material is a smooth lobe (diffuse: sampled, and lit through light samples), mirror and
// refraction (delta lobes), and "pass": straight through, which is no scattering. Lobes are chosen
// by roulette on the Fresnel reflectance, so that the weights stay free of it (section 3.4 of
// H. Dahlberg, "Parallel Path Tracing in CUDA", KTH, 2016).
#pragma once

#include "core/mapping.h"
#include "materials/fresnel.h"
#include "materials/sample.h"

namespace veriray {

enum class MaterialKind : uint32_t {
    kDiffuse,
    kConductor,
    kDielectric,
    kPlastic,
    kThinDielectric,
    kNull,
};
inline constexpr uint32_t kMaterialCount = 6;
constexpr uint32_t material_bit(MaterialKind k) { return 1u << static_cast<uint32_t>(k); }

// A surface's material as seen along wo. kKinds: the kinds that can occur (material_bit).
template <class L, uint32_t kKinds>
struct Bsdf {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    static constexpr bool has(MaterialKind k) { return (kKinds & material_bit(k)) != 0; }
    static constexpr bool kDiffuseOnly = kKinds == material_bit(MaterialKind::kDiffuse);
    static constexpr bool kGlass =
        has(MaterialKind::kDielectric) || has(MaterialKind::kThinDielectric);
    static constexpr bool kInterface = kGlass || has(MaterialKind::kPlastic);

    static constexpr bool kClear = kGlass || has(MaterialKind::kNull);

    U kind;
    S albedo;  // diffuse: reflectance; plastic: reflectance of the base within the coat
    S reflection, transmission, eta, k;
    V n;      // shading normal on wo's side
    F cos_o;  // of wo to n, positive
    FresnelSplit<F> fresnel;
    F relative;  // index beyond over index on wo's side

    VR_HD M is(MaterialKind which) const { return kind == U(static_cast<uint32_t>(which)); }

    // from_front: wo looks at the front, where eta is inside over outside.
    VR_HD void set_view(V wo_normal, F cosine, M from_front) {
        n = wo_normal;
        cos_o = cosine;
        if constexpr (kInterface) {
            relative = eta[0];
            if constexpr (has(MaterialKind::kDielectric))  // coats look alike from both sides
                relative =
                    select(is(MaterialKind::kDielectric) & !from_front, F(1.f) / eta[0], relative);
            fresnel = fresnel_dielectric(min(cos_o, F(1.f)), relative);
            if constexpr (has(MaterialKind::kThinDielectric)) {  // all inter-reflections
                const F r = fresnel.reflected;
                const F slab = select(r < F(1.f), (r + r) / (F(1.f) + r), F(1.f));
                fresnel.reflected =
                    select(is(MaterialKind::kThinDielectric), slab, fresnel.reflected);
            }
        }
    }

    // Made of delta lobes that let light through.
    VR_HD M clear() const {
        return is(MaterialKind::kDielectric) | is(MaterialKind::kThinDielectric) |
               is(MaterialKind::kNull);
    }

    VR_HD M smooth() const {
        M m = is(MaterialKind::kDiffuse);
        if constexpr (has(MaterialKind::kPlastic)) m = m | is(MaterialKind::kPlastic);
        return m;
    }

    // Smooth lobe for light from wi on wo's side; cos_i positive.
    VR_HD BsdfValue<F> eval(F cos_i) const {
        const F pdf = cosine_hemisphere_pdf_sa(cos_i);
        BsdfValue<F> value{albedo * pdf, pdf};
        if constexpr (has(MaterialKind::kPlastic)) {
            const F base = F(1.f) - fresnel.reflected;
            const F in = F(1.f) - fresnel_dielectric(min(cos_i, F(1.f)), relative).reflected;
            const M coat = is(MaterialKind::kPlastic);
            value.f_cos = select(coat, value.f_cos * (in * base), value.f_cos);
            value.pdf_sa = select(coat, pdf * base, pdf);
        }
        return value;
    }

    // u, v: direction; lobe: choice. All three in [0, 1).
    VR_HD BsdfSample<L> sample(V wo, F u, F v, F lobe) const {
        const M nobody = kind == U(kMaterialCount);
        const F zero(0.f);
        BsdfSample<L> s{{zero, zero, zero}, S::all(zero), zero, nobody, nobody};
        if constexpr (has(MaterialKind::kDiffuse) || has(MaterialKind::kPlastic)) {
            const V local = cosine_hemisphere(u, v);
            V a, b;
            orthonormal_frame(n, a, b);
            s.wi = fma(a, local.x, fma(b, local.y, n * local.z));
            s.pdf_sa = cosine_hemisphere_pdf_sa(local.z);
            s.weight = albedo;
            if constexpr (has(MaterialKind::kPlastic)) {
                const M coat = is(MaterialKind::kPlastic);
                const F in = F(1.f) - fresnel_dielectric(min(local.z, F(1.f)), relative).reflected;
                s.weight = select(coat, albedo * in, s.weight);
                s.pdf_sa = select(coat, s.pdf_sa * (F(1.f) - fresnel.reflected), s.pdf_sa);
            }
        }
        if constexpr (kDiffuseOnly) return s;
        M mirror = nobody;
        S colour = reflection;
        if constexpr (kInterface) mirror = (lobe < fresnel.reflected) & !is(MaterialKind::kDiffuse);
        if constexpr (has(MaterialKind::kConductor)) {
            const M metal = is(MaterialKind::kConductor);
            mirror = (mirror & !metal) | metal;
            const F c = min(cos_o, F(1.f));
            colour = select(metal, reflection * S::of([&](uint32_t i) {
                                       return fresnel_conductor(c, eta[i], k[i]);
                                   }),
                            colour);
        }
        mirror = mirror & !is(MaterialKind::kNull);
        if (any(mirror)) {
            s.wi = select(mirror, reflected(wo, n, cos_o), s.wi);
            s.weight = select(mirror, colour, s.weight);
            s.pdf_sa = select(mirror, F(0.f), s.pdf_sa);
        }
        if constexpr (has(MaterialKind::kDielectric)) {
            const M through = is(MaterialKind::kDielectric) & !mirror;
            s.wi = select(through, refracted(wo, n, cos_o, fresnel.cos_t, relative), s.wi);
            s.weight = select(through, refraction_weight(), s.weight);
            s.pdf_sa = select(through, F(0.f), s.pdf_sa);
            s.transmitted = through;
        }
        if constexpr (has(MaterialKind::kThinDielectric) || has(MaterialKind::kNull)) {
            const M null = is(MaterialKind::kNull);
            s.pass = (is(MaterialKind::kThinDielectric) & !mirror) | null;
            s.wi = select(s.pass, -wo, s.wi);
            s.weight = select(s.pass, select(null, S::all(F(1.f)), transmission), s.weight);
        }
        return s;
    }

    // Radiance is compressed with the solid angle.
    VR_HD S refraction_weight() const { return transmission * (F(1.f) / (relative * relative)); }

    // Instead of a direction on the wrong side of a smooth surface, for clear lanes of `wrong`: the
    // lobe that was chosen, about the geometric normal; the mirror where that reflects all.
    VR_HD void sample_flat(BsdfSample<L>& s, V wo, V ng, M from_front, M wrong) const {
        if constexpr (kGlass) {
            wrong = wrong & clear();
            if (none(wrong)) return;
            Bsdf flat = *this;
            flat.set_view(ng, dot(ng, wo), from_front);
            const M through = wrong & s.transmitted & (flat.fresnel.cos_t > F(0.f));
            const M mirror = wrong & !through;
            s.wi = select(mirror, reflected(wo, ng, flat.cos_o), s.wi);
            s.weight = select(mirror, reflection, s.weight);
            s.wi = select(through, refracted(wo, ng, flat.cos_o, flat.fresnel.cos_t, flat.relative),
                          s.wi);
            s.weight = select(through, refraction_weight(), s.weight);
            s.transmitted = s.transmitted & !mirror;
        }
    }

    // Share of light that goes straight through.
    VR_HD S pass_through() const {
        S t = S::all(select(is(MaterialKind::kNull), F(1.f), F(0.f)));
        if constexpr (has(MaterialKind::kThinDielectric))
            t = select(is(MaterialKind::kThinDielectric),
                       transmission * (F(1.f) - fresnel.reflected), t);
        return t;
    }
};

}  // namespace veriray
