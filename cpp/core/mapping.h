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

// Barycentric weights of the second and third vertex, uniform over a triangle (G. Turk,
// "Generating Random Points in Triangles", Graphics Gems, 1990).
template <class F>
VR_HD void uniform_triangle(F u, F v, F& b1, F& b2) {
    const F r = sqrt(u);
    b1 = r * (F(1.f) - v);
    b2 = r * v;
}

// Uniform over the unit disc.
template <class F>
VR_HD void uniform_disk(F u, F v, F& x, F& y) {
    F s, c;
    sincos_2pi(v, s, c);
    const F r = sqrt(u);
    x = r * c;
    y = r * s;
}

// Directions within a cone about +z, uniform in solid angle. The cone is given by one_minus_cos of
// its half angle, in (0, 2], to keep narrow cones exact: the errors of x and y are relative, down
// to 10^-30 sr.
template <class F>
VR_HD Vec3<F> uniform_cone(F u, F v, F one_minus_cos) {
    F s, c;
    sincos_2pi(v, s, c);
    const F h = u * one_minus_cos;
    const F r = sqrt(h * (F(2.f) - h));
    return {r * c, r * s, F(1.f) - h};
}
template <class F>
VR_HD F uniform_cone_pdf_sa(F one_minus_cos) {
    return F(0.5f * kInvPi) / one_minus_cos;
}

// A right-handed basis: cross(a, b) = n, where n is a unit vector. T. Duff et al., "Building an
// Orthonormal Basis, Revisited", JCGT 6(1), 2017.
template <class F>
VR_HD void orthonormal_frame(Vec3<F> n, Vec3<F>& a, Vec3<F>& b) {
    const F sign = select(n.z < F(0.f), F(-1.f), F(1.f));
    const F p = F(-1.f) / (sign + n.z);
    const F q = n.x * n.y * p;
    a = {fma(sign * n.x * n.x, p, F(1.f)), sign * q, -(sign * n.x)};
    b = {q, fma(n.y * n.y, p, sign), -n.y};
}

// Exponentially distributed with mean 1, from 32 random bits: -log((bits + 1/2) 2^-32), which lies
// between 1.2e-10 and 22.9.
template <class U>
VR_HD auto exponential(U bits) {
    using F = decltype(as_float(bits));
    const auto scaled = [](U b) {  // rounded once
        return fma(to_float(b >> 8), F(256.f), to_float(b & U(255u)) + F(0.5f)) * F(0x1p-32f);
    };
    const F x = scaled(bits);
    F f, e;
    float_parts(x, f, e);
    f = select(x < F(kRootHalf), f, -scaled(bits ^ U(~0u)));  // x - 1 from the other end
    return -log_of_parts(f, e);
}

// Offset in [-1, 1) with density 1 - |x|.
template <class F>
VR_HD F tent(F u) {
    const auto left = u < F(0.5f);
    const F r = F(1.f) - sqrt(F(2.f) * select(left, u, F(1.f) - u));
    return select(left, -r, r);
}

}  // namespace veriray
