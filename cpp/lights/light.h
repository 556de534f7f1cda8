// Light sampling: area lights of every shape, point, spot and directional lights.
#pragma once

#include "core/mapping.h"
#include "core/rng.h"
#include "lights/rectangle_light.h"
#include "lights/sphere_light.h"
#include "spectrum/spectrum.h"

namespace veriray {

inline constexpr float kShadowShorten = 1.f - 0x1p-21f;

enum class LightShape : uint32_t {
    kParallelogram,
    kTriangle,
    kDisk,
    kSphere,
    kPoint,
    kSpot,
    kDirectional,
    kRectangle,  // sampled by solid angle where that is large
    kTouching,   // not a shape: a flat light may touch what lets light through
};
constexpr uint32_t shape_bit(LightShape s) { return 1u << static_cast<uint32_t>(s); }
inline constexpr uint32_t kFlatLights =
    shape_bit(LightShape::kParallelogram) | shape_bit(LightShape::kTriangle) |
    shape_bit(LightShape::kDisk) | shape_bit(LightShape::kRectangle);
inline constexpr uint32_t kDeltaShapes = shape_bit(LightShape::kPoint) |
                                         shape_bit(LightShape::kSpot) |
                                         shape_bit(LightShape::kDirectional);

// Columns of the light table (one row per light).
enum LightColumn : uint32_t {
    kLightP,                 // a vertex, the centre, or the position: 3 columns
    kLightE1 = kLightP + 3,  // edges or half axes: 3 columns each
    kLightE2 = kLightE1 + 3,
    kLightN = kLightE2 + 3,      // unit: normal of the emitting side, or direction of the light
    kLightOffset = kLightN + 3,  // shift along the normal past the rounding of a point (see below)
    kLightShape,
    kLightInverse,   // 1 / selection probability; times the area for flat lights
    kLightRadiance,  // radiance, intensity, or irradiance across the beam: 3 columns
    kLightPrimitive = kLightRadiance + 3,                 // bits
    kRectangleUnit,                                       // rectangles: RectangleView's, 4 columns
    kRectangleOther = kRectangleUnit + kRectangleFloats,  // bits: the primitive with u >= v
    kLightColumns,
    // A sphere has its record (geometry/sphere.h) from kLightP on and its emitting side in kLightN:
    // 1 outside, -1 inside, -2 inside of a surface that lets light through. A spot has these:
    kSpotCutoff = kLightE1,  // radians
    kSpotInverse,            // 1 / (cutoff - beam)
};

struct LightView {
    const float* table;   // [column][stride]
    const uint32_t* cdf;  // upper ends of the selection intervals in units of 2^-24; last is 2^24
    uint32_t stride, count;
    uint32_t top_step;  // largest power of two <= count
    float environment[3];
};

template <class L>
struct LightSample {
    using F = typename L::F;
    Spectrum<F> radiance;  // towards the receiver; 0 from the back
    F inverse_pdf;         // per solid angle, selection included; selection only for delta lights
    F distance;            // a shadow ray's length; infinity for directional lights
    Vec3<F> wi;            // unit
    typename L::M delta;   // no ray can meet the light
    typename L::U skip;    // primitive that does not block: the light itself, which the ray meets
};

// The light whose interval holds u24 in [0, 2^24): its probability is exactly its share of 2^24.
template <class U>
VR_HD U choose_light(const LightView& lights, U u24) {
    U first(0u);
    for (uint32_t step = lights.top_step; step; step >>= 1) {
        const U next = first + U(step);
        const auto valid = next < U(lights.count + 1u);
        const U end = gather(lights.cdf, select(valid, next, U(1u)) + U(~0u));
        first = select(valid & !(u24 < end), next, first);
    }
    return first;
}

template <class L, uint32_t kShapes>
struct LightSampler {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    static constexpr bool has(LightShape s) { return (kShapes & shape_bit(s)) != 0; }

    template <class Column>
    static VR_HD V column3(Column column, uint32_t c) {
        return {column(c), column(c + 1), column(c + 2)};
    }
    template <class Column>
    static VR_HD S radiance(Column column) {
        return S::of([&](uint32_t k) { return column(kLightRadiance + k); });
    }
    template <class Column>
    static VR_HD M is(Column column, LightShape s) {
        return column(kLightShape) == F(static_cast<float>(s));
    }

    // A light as seen from p. `column` reads a column of the chosen light per lane; u, v in [0, 1).
    template <class Column>
    static VR_HD LightSample<L> sample(Column column, V p, F u, F v, M nobody) {
        LightSample<L> s;
        s.delta = nobody;
        s.skip = U(~0u);
        if constexpr ((kShapes & kFlatLights) != 0) flat(column, p, u, v, s);
        if constexpr (has(LightShape::kSphere)) {
            const M sphere = is(column, LightShape::kSphere);
            if (kShapes == shape_bit(LightShape::kSphere) || any(sphere))
                merge(s, sphere, from_sphere(column, p, u, v, nobody));
        }
        if constexpr ((kShapes & kDeltaShapes) != 0) {
            const M point = is(column, LightShape::kPoint) | is(column, LightShape::kSpot);
            if (any(point)) merge(s, point, from_point(column, p, point));
            const M far = is(column, LightShape::kDirectional);
            if (any(far))
                merge(s, far,
                      {radiance(column), column(kLightInverse), F(kInfinity),
                       -column3(column, kLightN), far, U(~0u)});
        }
        return s;
    }

    static VR_HD void merge(LightSample<L>& s, M m, const LightSample<L>& other) {
        s.radiance = select(m, other.radiance, s.radiance);
        s.inverse_pdf = select(m, other.inverse_pdf, s.inverse_pdf);
        s.distance = select(m, other.distance, s.distance);
        s.wi = select(m, other.wi, s.wi);
        s.delta = s.delta | (m & other.delta);
        s.skip = select(m, other.skip, s.skip);
    }

    // The light as a rectangle seen from p.
    template <class Column>
    static VR_HD RectangleView<F> rectangle(Column column, V p) {
        F shape[kRectangleFloats];
        for (uint32_t k = 0; k < kRectangleFloats; ++k) shape[k] = column(kRectangleUnit + k);
        return {shape, column3(column, kLightP) - p, column3(column, kLightE1),
                column3(column, kLightE2), column3(column, kLightN)};
    }

    // 1 / the density of light samples at p, selection included, if they are drawn by solid angle;
    // else 0.
    template <class Column>
    static VR_HD F inverse_pdf_by_angle(Column column, V p, M valid) {
        valid = valid & is(column, LightShape::kRectangle);
        if (none(valid)) return F(0.f);
        const RectangleView<F> view = rectangle(column, p);
        return select(valid & view.by_angle(), column(kLightInverse) * view.share(), F(0.f));
    }

    // Uniform in area or in solid angle. A shadow ray must end before the light itself, so the
    // point is moved off the light by a bound on the absolute rounding of its plane's distance, and
    // the ray is shortened by a bound on the relative rounding (plane distance, length and their
    // division: below 6 units of 2^-24). If the light is sampled by solid angle or touches
    // something, the point stays, because moving it would change the density of directions near the
    // light; the ray then ends before the moved plane.
    template <class Column>
    static VR_HD void flat(Column column, V p, F u, F v, LightSample<L>& s) {
        const F u0 = u, v0 = v;
        if constexpr (has(LightShape::kTriangle)) {
            F b1, b2;
            uniform_triangle(u0, v0, b1, b2);
            const M triangle = is(column, LightShape::kTriangle);
            u = select(triangle, b1, u);
            v = select(triangle, b2, v);
        }
        if constexpr (has(LightShape::kDisk)) {
            F x, y;
            uniform_disk(u0, v0, x, y);
            const M disk = is(column, LightShape::kDisk);
            u = select(disk, x, u);
            v = select(disk, y, v);
        }
        F share(0.f);  // of the area, as a solid angle
        M by_angle = u0 < F(0.f), stays = by_angle;
        F offset = column(kLightOffset);
        s.skip = as_uint(column(kLightPrimitive));
        if constexpr (has(LightShape::kRectangle)) {
            const M rectangular = is(column, LightShape::kRectangle);
            if (any(rectangular)) {
                const RectangleView<F> view = rectangle(column, p);
                by_angle = rectangular & view.by_angle();
                if (any(by_angle)) {
                    F a, b;
                    view.sample(u0, v0, a, b);
                    u = select(by_angle, a, u);
                    v = select(by_angle, b, v);
                    share = view.share();
                }
                s.skip = select(rectangular & (u >= v), as_uint(column(kRectangleOther)), s.skip);
            }
            stays = by_angle;
        }
        if constexpr (has(LightShape::kTouching)) {
            stays = stays | (offset < F(0.f));
            offset = abs(offset);
        }
        const V n = column3(column, kLightN);
        V q = fma(column3(column, kLightE1), u,
                  fma(column3(column, kLightE2), v, column3(column, kLightP)));
        q = fma(n, select(stays, F(0.f), offset), q);
        const V to = q - p;
        const F distance = sqrt(dot(to, to)), inverse = F(1.f) / distance;
        s.distance = distance * F(kShadowShorten);
        s.wi = to * inverse;
        const F cos_light = -dot(n, s.wi);
        s.radiance = select(cos_light > F(0.f), radiance(column), S::all(F(0.f)));
        s.inverse_pdf = column(kLightInverse) * (inverse * inverse) * cos_light;
        if constexpr (has(LightShape::kRectangle)) {
            s.inverse_pdf = select(by_angle, column(kLightInverse) * share, s.inverse_pdf);
        }
        if constexpr (has(LightShape::kRectangle) || has(LightShape::kTouching)) {
            s.distance = select(stays, max(s.distance - offset / cos_light, F(0.f)), s.distance);
        }
    }

    // The sphere is convex, so it hides none of the points that p can see, and the shadow ray skips
    // it. If its surface lets light through, its inside is seen from outside across that surface;
    // the shadow ray then ends before the far side.
    template <class Column>
    static VR_HD LightSample<L> from_sphere(Column column, V p, F u, F v, M nobody) {
        F record[kSphereFloats];
        for (uint32_t k = 0; k < kSphereFloats; ++k) record[k] = column(kLightP + k);
        const SphereLightSample<F> at = sample_sphere_light(record, p, u, v);
        const F side = column(kLightN);
        const M across = (side < F(-1.f)) & (at.cos_light > F(0.f));
        const M lit = across | ((at.cos_light * side) > F(0.f));
        return {select(lit, radiance(column), S::all(F(0.f))),
                column(kLightInverse) * at.inverse_pdf,
                select(across, at.far * F(kShadowShorten), at.distance),
                at.wi,
                nobody,
                select(across, U(~0u), as_uint(column(kLightPrimitive)))};
    }

    // Intensity over squared distance; a spot's falloff is linear in the angle, as Mitsuba's.
    template <class Column>
    static VR_HD LightSample<L> from_point(Column column, V p, M valid) {
        const V to = column3(column, kLightP) - p;
        const F d2 = dot(to, to), distance = sqrt(d2);
        const V wi = to * (F(1.f) / distance);
        S intensity = radiance(column) * (F(1.f) / d2);
        if constexpr (has(LightShape::kSpot)) {
            const M spot = is(column, LightShape::kSpot);
            if (any(spot)) {
                // From sine and cosine: a cosine alone does not resolve small angles.
                const V axis = column3(column, kLightN), across = cross(wi, axis);
                const F off = angle(-dot(wi, axis), sqrt(dot(across, across)));
                const F edge = (column(kSpotCutoff) - off) * column(kSpotInverse);
                const F share = max(min(edge, F(1.f)), F(0.f));
                intensity = select(spot, intensity * share, intensity);
            }
        }
        return {intensity, column(kLightInverse), distance * F(kShadowShorten), wi, valid, U(~0u)};
    }
};

}  // namespace veriray
