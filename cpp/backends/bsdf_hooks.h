// What the tests ask of materials (backends/hooks.h).
#pragma once

#include "bsdfs/bsdf.h"

namespace veriray {

template <class F>
VR_HD void put(F* y, Vec3<F> v) {
    y[0] = v.x, y[1] = v.y, y[2] = v.z;
}

template <class F>
VR_HD void put(F* y, const Spectrum<F>& s) {
    for (uint32_t k = 0; k < kChannels; ++k) y[k] = s[k];
}

// A grey material seen from wo: kind, front (1: wo sees it), albedo, specular reflectance and
// transmittance, eta, k, alpha_u, alpha_v, distribution, the 10 shares of a principled one as the
// schema has them and diff_trans, n (on wo's side), wo. Of hair its three numbers stand in the
// places of alpha_u, alpha_v and distribution. The tangent lies across n and (0, 1, 0.2). table: of
// a rough coat, which lets in what a smooth one does, or of mirrors, which lose cosine / 4, of an
// interface cosine / 16 in front and cosine / 8 from behind.
inline constexpr uint32_t kBsdfInputs = 27, kHookColumns = kLostBehind + kLostCells + 1;

// The table, and what it follows from.
template <class L>
struct HookTable {
    typename L::F kind, eta, alpha;
    float numbers[kHookColumns * L::kWidth];
    bool made = false;
};

template <class L>
VR_HD Bsdf<L, kAllKinds> bsdf_of(const typename L::F* x, HookTable<L>& table) {
    using F = typename L::F;
    const Vec3<F> n{x[21], x[22], x[23]}, wo{x[24], x[25], x[26]};
    Bsdf<L, kAllKinds> b;
    b.kind = to_uint(x[0]);
    using S = Spectrum<F>;
    auto& p = b.parameters;
    p.reflectance = S::all(x[2]);
    p.specular_reflectance = S::all(x[3]), p.specular_transmittance = S::all(x[4]);
    p.eta = S::all(x[5]), p.k = S::all(x[6]);
    p.alpha_u = x[7], p.alpha_v = x[8], p.distribution = x[9];
    p.roughness = x[10], p.metallic = x[11], p.spec_trans = x[12], p.spec_tint = x[13];
    p.sheen = x[14], p.sheen_tint = x[15], p.flatness = x[16];
    p.clearcoat = x[17], p.clearcoat_gloss = x[18], p.anisotropic = x[19];
    p.diff_trans = x[20];
    p.hair_along = x[7], p.hair_around = x[8], p.hair_tilt = x[9];
    const Vec3<F> along = cross(n, Vec3<F>{F(0.f), F(1.f), F(0.2f)});
    b.view.tangents = true, b.view.tangent = along * (F(1.f) / sqrt(dot(along, along)));
    if (none(b.template any_of<kTables>())) {
        b.set_view(n, dot(n, wo), x[1] > F(0.f));
        return b;
    }
    uint32_t lane[L::kWidth];
    for (uint32_t k = 0; k < L::kWidth; ++k) lane[k] = k;
    b.view.table = {table.numbers, L::kWidth, load(lane, typename L::U())};
    if (!table.made || any(!((table.kind == x[0]) & (table.eta == x[5]) & (table.alpha == x[7])))) {
        table.made = true, table.kind = x[0], table.eta = x[5], table.alpha = x[7];
        const auto whole = b.template any_of<kWholeKinds>();
        const auto metal = b.template any_of<kMetalKinds>();
        const F through = F(0.25f) * x[5] * x[5];
        const F numbers[4] = {
            select(metal, F(1.f / 6.f), F(1.f / 24.f)), select(metal, F(0.5f), through),
            select(metal, F(0.5f), F(1.f / 12.f)), select(metal, F(0.5f), F(0.125f))};
        for (uint32_t k = 0; k < kHookColumns; ++k) {
            const F cosine(static_cast<float>(k % (kCoatCells + 1)) / kCoatCells);
            const F entering = F(1.f) - fresnel_dielectric(cosine, x[5]).reflected;
            const uint32_t cell = (k + kLostCells + 1 - kLostAtCosine) % (kLostCells + 1);
            const float t = static_cast<float>(cell) / kLostCells;
            const F q = F((1.f - t) / t * ((1.f - t) / t)) / p.alpha_u;  // tangent of the angle
            const F share = select(metal, F(0.25f), F(k < kLostBehind ? 0.0625f : 0.125f));
            const F lost = share / sqrt(fma(q, q, F(1.f)));
            store(table.numbers + k * L::kWidth,
                  select(whole, k < kLostAtCosine ? numbers[k < 3 ? k : 3] : lost, entering));
        }
    }
    b.set_view(n, dot(n, wo), x[1] > F(0.f));
    return b;
}

// importance: a sample's weight of importance is wanted too.
template <class L>
VR_HD void evaluate_bsdf(bool sample, bool importance, const typename L::F* x, typename L::F* y) {
    using F = typename L::F;
    const F one(1.f), none(0.f);
#if VR_CUDA
    HookTable<L> table;
#else
    thread_local HookTable<L> table;  // many rows have one
#endif
    const auto b = bsdf_of<L>(x, table);
    const Vec3<F> wo{x[24], x[25], x[26]};
    const auto from_front = x[1] > none;
    x += kBsdfInputs;
    if (sample) {
        const BsdfSample<L> s = b.sample(wo, {x[0], x[1], x[2]});
        put(y, s.wi);
        y[3] = s.weight[0], y[4] = s.pdf_sa;
        y[5] = select(s.transmitted, one, none), y[6] = select(s.pass, one, none);
        y[7] = select(b.template any_of<kIndexedKinds>(), b.view.fresnel.reflected, none);
        if (!importance) return;
        auto light = b;
        light.view.transport = Transport::kImportance;
        y[8] = light.sample(wo, {x[0], x[1], x[2]}).weight[0];
        return;
    }
    const Vec3<F> wi{x[0], x[1], x[2]};
    const F cos_i = dot(b.view.n, wi);
    const auto behind = b.transmits() & (cos_i < none);
    const auto lit = (b.scatters() & (cos_i > none)) | behind;
    const BsdfValue<F> value = b.eval(wo, wi, select(behind, cos_i, max(cos_i, none)));
    y[0] = select(lit, value.f_cos[0], none), y[1] = select(lit, value.pdf_sa, none);
    y[2] = b.pass_through()[0];
    const F back = b.reverse_pdf(wo, wi, b.view.cos_o, max(cos_i, none), from_front);
    y[3] = select(lit & !behind, back, none), y[4] = b.albedo()[0];
}

}  // namespace veriray
