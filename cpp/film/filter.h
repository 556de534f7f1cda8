// Pixel filters. Feature images, and pictures under a box or a filter narrower than a pixel, draw
// samples from the size of the filter; each belongs to one pixel. Under other filters a picture's
// samples lie evenly in their pixels and count in all that the filter reaches (shared.h).
#pragma once

#include "core/mapping.h"

namespace veriray {

enum class FilterKind : uint32_t { kBox, kTent, kTable };
enum class FilterForm : uint32_t { kTent, kGaussian, kCubic, kLanczos };
inline constexpr uint32_t kFilterTable =
    4096;                            // cells of equal probability, kFilterTable + 1 edges
inline constexpr int kMostRim = 16;  // pixels; a sample costs time by its square

struct FilterView {
    FilterKind kind;
    float radius;        // pixels; tent only
    const float* edges;  // inverse distribution of |f| in pixels; table only
    FilterForm form;
    uint32_t rim;  // pixels to each side that share samples; 0: samples are not shared
    float room;    // above the sum of the sizes of a shared sample's weights; see shared.h
    float size, slope, end;  // of forms other than kCubic; see filter_at
    float near[4], far[4];   // of kCubic: coefficients, the highest first, below and beyond 1

    // Integral of f, which is 1 in all, over the pixel `i - rim` from its own along an axis.
    VR_HD float part(uint32_t i) const { return edges[kFilterTable + 1 + i]; }
    // The inverse of the integral over the other pixels than (i - rim, j - rim).
    VR_HD float others(uint32_t i, uint32_t j) const { return part((j + 1) * (2 * rim + 1) + i); }
};

// Offset from the pixel's centre, in pixels, along one axis.
template <class L>
VR_HD typename L::F filter_offset(const FilterView& f, typename L::F u) {
    using F = typename L::F;
    if (f.kind == FilterKind::kBox) return u - F(0.5f);
    if (f.kind == FilterKind::kTent) return tent(u) * F(f.radius);
    const F x = u * F(static_cast<float>(kFilterTable));
    const auto cell = to_uint(x);
    const F a = gather(f.edges, cell), b = gather(f.edges + 1, cell);
    return fma(x - to_float(cell), b - a, a);
}

// The filter's density along an axis at a distance from the pixel's centre, in pixels.
template <class F>
VR_HD F filter_at(const FilterView& f, F offset) {
    const F x = abs(offset), none(0.f);
    if (f.form == FilterForm::kTent) return max(fma(x, F(-f.slope), F(f.size)), none);
    if (f.form == FilterForm::kGaussian)
        return max(exp_minus(x * x * F(f.slope)) - F(f.end), none) * F(f.size);
    if (f.form == FilterForm::kLanczos) {
        // sin(pi x) and sin(pi x / end); at 2^-13 their product over x^2 is within 3e-8 of that at
        // 0
        const F away = max(x, F(0x1p-13f)), half = away * F(0.5f);
        F narrow, wide, cosine;
        sincos_2pi(half - to_float(to_uint(half)), narrow, cosine);
        sincos_2pi(away * F(f.slope), wide, cosine);
        return select(x < F(f.end), narrow * wide / (away * away) * F(f.size), none);
    }
    const auto cubic = [&](const float* p) {
        return fma(fma(fma(x, F(p[0]), F(p[1])), x, F(p[2])), x, F(p[3]));
    };
    return select(x < F(1.f), cubic(f.near), select(x < F(2.f), cubic(f.far), none));
}

}  // namespace veriray
