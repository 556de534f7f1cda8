// Flat ellipses.
#pragma once

#include "geometry/ray.h"

namespace veriray {

inline constexpr uint32_t kDiskFloats =
    12;  // plane, {U, w}, {V, w}: (U.p + w)^2 + (V.p + w)^2 <= 1

// Whether a ray meets the ellipse at 0 < t < t_max, and where. A ray within the plane has a
// t that is NaN or beyond the ellipse, and fails the test.
template <class L>
VR_HD typename L::M meets_disk(const float* record, const Ray<L>& ray, typename L::F t_max,
                               typename L::F& t) {
    using F = typename L::F;
    t = plane_distance<L>(record, ray);
    const Vec3<F> p = ray.at(t);
    const F a = height_over<L>(record + 4, p), b = height_over<L>(record + 8, p);
    const auto inside = fma(a, a, b * b) <= F(1.f);
    return between<L>(inside, t, t_max);
}

}  // namespace veriray
