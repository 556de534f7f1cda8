// What a path carries from bounce to bounce, and what a bounce reports.
#pragma once

#include "geometry/ray.h"
#include "integrators/ledger.h"
#include "scene/view.h"

namespace veriray {

struct PathSettings {
    RandomKey key;
    uint32_t max_depth;  // segments at most, passes not counted; kHardMaxDepth for unlimited
    uint32_t rr_depth;   // roulette from the vertex with index + 1 >= rr_depth on
};

template <class L>
struct PathState {
    using F = typename L::F;
    using U = typename L::U;
    U pixel, sample;
    Ray<L> ray;
    Spectrum<F> throughput, radiance;
    F pdf_sa;     // of the direction at the last scattering; 0 where no light sample competes
    F scale;      // kRefraction: undoes the compression of radiance, for roulette
    F travelled;  // kPass: the ray has passed all up to this distance
    U passed;     // kPass: and, of what lies there, the primitives up to this one
    U vertices;   // kPass: scatterings so far
    U medium;     // kMedia: around the ray at `travelled`
};

// Of the fields below, those that say how far the ray has come.
inline constexpr uint32_t kPassedField = 3;
constexpr uint32_t travelled_field(uint32_t features) { return features & kRefraction ? 14 : 13; }

// The one list of a path's fields, for the schedulers that store it: f(index, lanes&), u(index,
// lanes&).
template <uint32_t kFeatures, class Path, class FloatField, class UintField>
VR_HD void each_field(Path& p, FloatField f, UintField u) {
    f(0, p.ray.o.x), f(1, p.ray.o.y), f(2, p.ray.o.z);
    f(3, p.ray.d.x), f(4, p.ray.d.y), f(5, p.ray.d.z);
    f(6, p.throughput[0]), f(7, p.throughput[1]), f(8, p.throughput[2]);
    f(9, p.radiance[0]), f(10, p.radiance[1]), f(11, p.radiance[2]);
    f(12, p.pdf_sa);
    u(0, p.pixel), u(1, p.sample);
    if constexpr (kFeatures & kRefraction) f(13, p.scale);
    if constexpr (kFeatures & kPass) {
        f(travelled_field(kFeatures), p.travelled);
        u(2, p.vertices);
        u(3, p.passed);
    }
    if constexpr (kFeatures & kMedia) u((kFeatures & kPass) ? 4 : 2, p.medium);
}
// Fields that some stages need alone; the ray's are the first 6.
inline constexpr uint32_t kRadianceField = 9, kPixelField = 0, kSampleField = 1;
constexpr uint32_t path_floats(uint32_t features) {
    return 13 + ((features & kRefraction) ? 1 : 0) + ((features & kPass) ? 1 : 0);
}
constexpr uint32_t path_uints(uint32_t features) {
    return 2 + ((features & kPass) ? 2 : 0) + ((features & kMedia) ? 1 : 0);
}
constexpr uint32_t path_bytes(uint32_t features) {
    return 4 * (path_floats(features) + path_uints(features));
}

// Features with which a shadow ray leaves a primitive out.
inline constexpr uint32_t kShadowSkips = kSphereLights | kPass | kBvh;

template <class L>
struct ShadowRequest {
    typename L::M wanted;
    Ray<L> ray;
    typename L::F t_max;
    Spectrum<typename L::F> radiance;  // added if the ray is free
    typename L::U skip;                // kShadowSkips: primitive that does not block
    typename L::U medium;              // kMedia: around the ray where it goes on
    typename L::F travelled;           // kPass: as of a path, and likewise
    typename L::U passed;
};

// Its list of fields before it has passed anything; `wanted` is none.
template <uint32_t kFeatures, class Request, class FloatField, class UintField>
VR_HD void each_shadow_field(Request& s, FloatField f, UintField u) {
    f(0, s.ray.o.x), f(1, s.ray.o.y), f(2, s.ray.o.z);
    f(3, s.ray.d.x), f(4, s.ray.d.y), f(5, s.ray.d.z);
    f(6, s.t_max);
    f(7, s.radiance[0]), f(8, s.radiance[1]), f(9, s.radiance[2]);
    if constexpr (kFeatures & kShadowSkips) u(0, s.skip);
    if constexpr (kFeatures & kMedia) u((kFeatures & kShadowSkips) ? 1 : 0, s.medium);
}
inline constexpr uint32_t kShadowFloats = 10;
constexpr uint32_t shadow_uints(uint32_t features) {
    return ((features & kShadowSkips) ? 1 : 0) + ((features & kMedia) ? 1 : 0);
}

// What happened to the lanes of a bounce; disjoint but for the last three.
template <class L>
struct Events {
    typename L::M escaped, emitter_end, absorbed, depth_cut, rr_killed, alive;
    typename L::M visible, occluded;  // the shadow ray
    typename L::M collided;           // in a medium
};

// A point of a surface, by lane.
template <class L>
struct Surface {
    Vec3<typename L::F> p;       // on the surface
    Vec3<typename L::F> ng, ns;  // unit, of the front: geometric and interpolated
    typename L::F offset;        // to leave the surface by, past the rounding of p
    typename L::M front;         // the ray met the front
    typename L::U row;           // of the surface table
};

}  // namespace veriray
