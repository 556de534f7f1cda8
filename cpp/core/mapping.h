// Maps from the unit square, with their densities. u, v in [0, 1).
#pragma once

#include "core/math.h"
#include "core/vec.h"

namespace veriray {

// Upper hemisphere with density cos(theta)/pi per solid angle (z = cos theta > 0).
template <class F>
VR_HD Vec3<F> cosine_hemisphere(F u, F v) {
    F s, c;
    sincos_2pi(v, s, c);
    const F r = sqrt(u);
    return {r * c, r * s, sqrt(F(1.f) - u)};
}
template <class F>
VR_HD F cosine_hemisphere_pdf_sa(F cos_theta) {
    return cos_theta * F(kInvPi);
}

// Whole sphere with density 1/(4 pi) per solid angle.
template <class F>
VR_HD Vec3<F> uniform_sphere(F u, F v) {
    F s, c;
    sincos_2pi(v, s, c);
    const F z = fma(F(-2.f), u, F(1.f));
    const F r = F(2.f) * sqrt(u * (F(1.f) - u));
    return {r * c, r * s, z};
}
inline constexpr float kUniformSpherePdf = 0.0795774715459476678844f;

// Barycentric weights of the second and third vertex, uniform over a triangle (A. Turk, 1990).
template <class F>
VR_HD void uniform_triangle(F u, F v, F& b1, F& b2) {
    const F r = sqrt(u);
    b1 = r * (F(1.f) - v);
    b2 = r * v;
}

// Offset in [-1, 1) with density 1 - |x|.
template <class F>
VR_HD F tent(F u) {
    const auto left = u < F(0.5f);
    const F r = F(1.f) - sqrt(F(2.f) * select(left, u, F(1.f) - u));
    return select(left, -r, r);
}

}  // namespace veriray
