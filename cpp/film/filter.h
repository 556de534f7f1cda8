// Pixel filters by importance sampling: every sample belongs to one pixel and has weight 1 or, for
// a filter with negative lobes, a weight of constant magnitude with the lobe's sign.
#pragma once

#include "core/mapping.h"

namespace veriray {

enum class FilterKind : uint32_t { kBox, kTent, kTable };
inline constexpr uint32_t kFilterTable =
    4096;  // cells of equal probability, kFilterTable + 1 edges

struct FilterView {
    FilterKind kind;
    float radius;        // pixels; tent only
    const float* edges;  // inverse distribution of |f| in pixels; table only
    float positive;      // f < 0 beyond this distance; infinity: nowhere
    float weight;        // integral of |f| over integral of f
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

// Weight of a sample at this offset along one axis.
template <class F>
VR_HD F filter_weight(const FilterView& f, F offset) {
    const F w(f.weight);
    return select(abs(offset) > F(f.positive), -w, w);
}

}  // namespace veriray
