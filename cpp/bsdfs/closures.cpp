// What the host asks of closures.
#include "bsdfs/closures.h"

#include "bsdfs/rough_coat.h"

namespace veriray {

const ClosureTraits& closure_traits(uint32_t kind) { return kClosures[kind]; }

float common_shadows(float a, float b) { return Microfacets<Scalar>::in_common(true, a, b, false); }

// The mean weight of mirrors that are drawn at the middles of cells: for GGX the visible ones; for
// Beckmann all of them, those of large slopes in smaller cells. By symmetry half of the azimuths.
// Where shadows are correlated by height, a cosine of 0 has no limit that is soon reached, and
// Mitsuba's 1e-6 stands for it.
double rough_share(bool through, float cosine, float eta, float alpha, bool ggx, bool correlated) {
    using V = Vec3<float>;
    constexpr uint32_t kCells = 48;
    if (correlated) cosine = max(cosine, 1e-6f);
    Microfacets<Scalar> facets{{}, {}, {}, alpha, alpha, ggx};
    const V o{sqrt(1.f - cosine * cosine), 0.f, cosine};
    const float masking = facets.seen(o);
    double sum = 0;
    for (uint32_t j = 0; j < kCells; ++j)
        for (uint32_t k = 0; k < kCells; ++k) {
            const float s = (static_cast<float>(j) + 0.5f) / kCells, rest = 1.f - s;
            const float u = s * (2.f - s), v = (static_cast<float>(k) + 0.5f) / (2 * kCells);
            float coin = 0.f, sine, cosine_v;
            sincos_2pi(v, sine, cosine_v);
            const float r = sqrt(-log(rest * rest));
            const V m =
                ggx ? facets.draw(o, u, v, coin) : facets.normal({r * cosine_v, r * sine, 1.f});
            const float om = dot(o, m);
            const FresnelSplit<float> split = fresnel_dielectric(min(om, 1.f), eta);
            const V i = through ? refracted(o, m, om, split.cos_t, eta) : reflected(o, m, om);
            const float up = through ? -i.z : i.z, area = ggx ? 1.f : masking * om / m.z;
            if (!(om > 0.f) || !(up > 0.f)) continue;
            const float share = through ? 1.f - split.reflected : split.reflected;
            const float lit = facets.seen(i) * up;
            const float both = facets.in_common(correlated, masking * cosine, lit, !through);
            sum += static_cast<double>(share * facets.seen(i) * up * area * 2.f * rest * both);
        }
    return sum / (kCells * kCells);
}

}  // namespace veriray
