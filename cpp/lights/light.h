// Light sampling: flat area lights and a constant environment.
#pragma once

#include "core/mapping.h"
#include "core/rng.h"

namespace veriray {

inline constexpr float kShadowShorten = 1.f - 0x1p-21f;

// Columns of the light table (one row per emitting primitive).
enum LightColumn : uint32_t {
    kLightP,                 // a vertex: 3 columns
    kLightE1 = kLightP + 3,  // edges from it: 3 columns each
    kLightE2 = kLightE1 + 3,
    kLightN = kLightE2 + 3,      // unit normal of the emitting side
    kLightOffset = kLightN + 3,  // shift along the normal past the rounding of a point (see below)
    kLightTriangle,              // 1 for a triangle, 0 for a parallelogram
    kLightPdfArea,               // choice probability / area
    kLightRadiance,              // 3 columns
    kLightColumns = kLightRadiance + 3,
};

struct LightView {
    const float* table;   // [column][stride]
    const uint32_t* cdf;  // upper ends of the choice intervals in units of 2^-24; last is 2^24
    uint32_t stride, count;
    uint32_t top_step;  // largest power of two <= count
    float environment[3];
    uint32_t environment_share;  // of 2^24: probability of choosing the environment
};

template <class F>
struct LightSample {
    Vec3<F> radiance;  // towards the receiver; 0 from the back
    F pdf_sa;          // choice included
    F distance;        // a shadow ray's length; infinity for the environment
    Vec3<F> wi;        // unit
};

// The area light whose interval holds u24 in [environment_share, 2^24): chosen with exactly its
// share of 2^-24ths.
template <class U>
VR_HD U choose_area_light(const LightView& lights, U u24) {
    U first(0u);
    for (uint32_t step = lights.top_step; step; step >>= 1) {
        const U next = first + U(step);
        const auto valid = next < U(lights.count + 1u);
        const U end = gather(lights.cdf, select(valid, next, U(1u)) + U(~0u));
        first = select(valid & !(u24 < end), next, first);
    }
    return first;
}

// Uniform on the chosen light's area, as seen from p. `column` reads a light column per lane.
// A shadow ray must end before the light itself. The point is moved off the light by the bound on
// the absolute rounding of its plane's distance, and the ray shortened by a bound on the relative
// one (plane distance, length and their division: below 6 units of 2^-24).
template <class L, class Column>
VR_HD LightSample<typename L::F> sample_area_light(Column column, Vec3<typename L::F> p,
                                                   typename L::F u, typename L::F v,
                                                   bool triangles) {
    using F = typename L::F;
    const auto column3 = [&](uint32_t c) {
        return Vec3<F>{column(c), column(c + 1), column(c + 2)};
    };
    if (triangles) {
        F b1, b2;
        uniform_triangle(u, v, b1, b2);
        const auto tri = column(kLightTriangle) > F(0.f);
        u = select(tri, b1, u);
        v = select(tri, b2, v);
    }
    const Vec3<F> n = column3(kLightN);
    Vec3<F> q = fma(column3(kLightE1), u, fma(column3(kLightE2), v, column3(kLightP)));
    q = fma(n, column(kLightOffset), q);
    LightSample<F> s;
    const Vec3<F> to = q - p;
    const F d2 = dot(to, to);
    const F distance = sqrt(d2);
    s.distance = distance * F(kShadowShorten);
    s.wi = to * (F(1.f) / distance);
    const F cos_light = -dot(n, s.wi);
    const Vec3<F> zero{F(0.f), F(0.f), F(0.f)};
    s.radiance = select(cos_light > F(0.f), column3(kLightRadiance), zero);
    s.pdf_sa = column(kLightPdfArea) * d2 / cos_light;
    return s;
}

template <class L>
VR_HD LightSample<typename L::F> sample_environment(const LightView& lights, typename L::F u,
                                                    typename L::F v) {
    using F = typename L::F;
    const Vec3<F> wi = uniform_sphere(u, v);
    const F share(static_cast<float>(lights.environment_share) * 0x1p-24f);
    return {broadcast<F>(lights.environment), share * F(kUniformSpherePdf), F(kInfinity), wi};
}

}  // namespace veriray
