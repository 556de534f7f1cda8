#pragma once

#include "core/math.h"
#include "core/vec.h"

namespace veriray {

// d has unit length to within rounding.
template <class L>
struct Ray {
    Vec3<typename L::F> o, d;
};

// Closest hit so far. Equal distances keep the smaller primitive, whatever the order of tests.
template <class L>
struct Hit {
    typename L::F t;  // infinity: none
    typename L::U primitive;
};

template <class L>
VR_HD void keep_closest(Hit<L>& hit, typename L::M inside, typename L::F t, uint32_t primitive) {
    using F = typename L::F;
    using U = typename L::U;
    const auto closer = (t < hit.t) | ((t == hit.t) & (U(primitive) < hit.primitive));
    const auto take = inside & (t > F(0.f)) & closer;
    hit.t = select(take, t, hit.t);
    hit.primitive = select(take, U(primitive), hit.primitive);
}

// Distance along the ray to the plane n.x = offset; infinite or NaN for a ray within it.
template <class L>
VR_HD typename L::F plane_distance(const Ray<L>& ray, const float* plane) {
    using F = typename L::F;
    const Vec3<F> n = broadcast<F>(plane);
    const F height = fma(-n.z, ray.o.z, fma(-n.y, ray.o.y, fma(-n.x, ray.o.x, F(plane[3]))));
    return height / dot(n, ray.d);
}

}  // namespace veriray
