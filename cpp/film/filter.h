// Pixel filters by importance sampling: every sample has weight 1 and belongs to one pixel.
#pragma once

#include "core/mapping.h"

namespace veriray {

enum class FilterKind : uint32_t { kBox, kTent, kTable };
inline constexpr uint32_t kFilterTable =
    4096;  // cells of equal probability, kFilterTable + 1 edges

struct FilterView {
    FilterKind kind;
    float radius;        // pixels; tent only
    const float* edges;  // inverse distribution in pixels; table only
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

}  // namespace veriray
