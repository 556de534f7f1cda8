// What a path carries from bounce to bounce, and what a bounce reports.
#pragma once

#include "core/rng.h"
#include "geometry/ray.h"
#include "integrators/ledger.h"
#include "scene/features.h"
#include "scene/view.h"

namespace veriray {

static_assert((kHardMaxDepth + 1) * kBlocksPerSegment < kSubpathBlocks);

struct PathSettings {
    RandomKey key;
    uint32_t max_depth;  // segments at most, passes not counted; kHardMaxDepth for unlimited
    uint32_t rr_depth;   // roulette from the vertex with index + 1 >= rr_depth on
    // Pixels of a film with a rim to each side are counted from the rim's first, by numbers from
    // `first` on; 0, 0: those of the film.
    uint32_t rim = 0, first = 0;
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
    F flight;     // kMedia: from there to the next collision, if nothing is met before
    U facing;     // kManyLights: of the last scattering, for the choice of lights
};

// Which stages take a field of a path that lies in memory.
enum FieldUse : uint32_t {
    kFixed = 1,     // set when the path begins
    kAhead = 2,     // all that tracing needs
    kGathered = 4,  // where light is added
    kCarried = 8,
    kWholePath = kFixed | kAhead | kGathered | kCarried,
};

// The one list of a path's fields: float or uint column, value, features that need it (0: all),
// use. What follows from it: columns of the schedulers that store paths, their number,
// `path_bytes`.
#define VR_PATH_FIELDS(FIELD)              \
    FIELD(u, pixel, 0, kFixed)             \
    FIELD(u, sample, 0, kFixed)            \
    FIELD(f, ray.o.x, 0, kAhead)           \
    FIELD(f, ray.o.y, 0, kAhead)           \
    FIELD(f, ray.o.z, 0, kAhead)           \
    FIELD(f, ray.d.x, 0, kAhead)           \
    FIELD(f, ray.d.y, 0, kAhead)           \
    FIELD(f, ray.d.z, 0, kAhead)           \
    FIELD(f, throughput[0], 0, kCarried)   \
    FIELD(f, throughput[1], 0, kCarried)   \
    FIELD(f, throughput[2], 0, kCarried)   \
    FIELD(f, radiance[0], 0, kGathered)    \
    FIELD(f, radiance[1], 0, kGathered)    \
    FIELD(f, radiance[2], 0, kGathered)    \
    FIELD(f, pdf_sa, 0, kCarried)          \
    FIELD(f, scale, kRefraction, kCarried) \
    FIELD(f, travelled, kPass, kAhead)     \
    FIELD(u, passed, kPass, kAhead)        \
    FIELD(u, vertices, kPass, kCarried)    \
    FIELD(u, medium, kMedia, kCarried)     \
    FIELD(f, flight, kMedia, kCarried)     \
    FIELD(u, facing, kManyLights, kCarried)

constexpr bool needs_field(FeatureMask features, FeatureMask need) {
    return need == 0 || (features & need) != 0;
}

struct ColumnCount {
    uint32_t floats, uints;
};
// Calls f(column, lanes&), u(column, lanes&) for a list's fields, and counts the columns.
#define VR_VISIT_FIELD(type, value, need, use)                         \
    if constexpr (needs_field(kFeatures, need)) {                      \
        if constexpr ((kUse & (use)) != 0) type(column.type, x.value); \
        ++column.type;                                                 \
    }
#define VR_COUNT_FIELD(type, value, need, use) \
    if (needs_field(features, need)) ++column.type;

template <FeatureMask kFeatures, uint32_t kUse, class Path, class FloatField, class UintField>
VR_HD void each_path_field(Path& x, FloatField f, UintField u) {
    struct {
        uint32_t f = 0, u = 0;
    } column;
    VR_PATH_FIELDS(VR_VISIT_FIELD)
}
constexpr ColumnCount path_columns(FeatureMask features) {
    struct {
        uint32_t f = 0, u = 0;
    } column;
    VR_PATH_FIELDS(VR_COUNT_FIELD)
    return {column.f, column.u};
}
constexpr uint32_t path_bytes(FeatureMask features) {
    return 4 * (path_columns(features).floats + path_columns(features).uints);
}

// Features with which paths go on straight through surfaces.
inline constexpr FeatureMask kGoOn = kPass | kHidden;

// Features with which a shadow ray leaves a primitive out.
inline constexpr FeatureMask kShadowSkips = kSkippedLights | kPass | kBvh;

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
    RandomStream<typename L::U> random;  // kUnevenMedia: of the steps through them
};

// Its fields before it has passed anything; `wanted` is none.
#define VR_SHADOW_FIELDS(FIELD)                  \
    FIELD(f, ray.o.x, 0, kWholePath)             \
    FIELD(f, ray.o.y, 0, kWholePath)             \
    FIELD(f, ray.o.z, 0, kWholePath)             \
    FIELD(f, ray.d.x, 0, kWholePath)             \
    FIELD(f, ray.d.y, 0, kWholePath)             \
    FIELD(f, ray.d.z, 0, kWholePath)             \
    FIELD(f, t_max, 0, kWholePath)               \
    FIELD(f, radiance[0], 0, kWholePath)         \
    FIELD(f, radiance[1], 0, kWholePath)         \
    FIELD(f, radiance[2], 0, kWholePath)         \
    FIELD(u, skip, kShadowSkips, kWholePath)     \
    FIELD(u, medium, kMedia, kWholePath)         \
    FIELD(u, random.a, kUnevenMedia, kWholePath) \
    FIELD(u, random.b, kUnevenMedia, kWholePath)

template <FeatureMask kFeatures, class Request, class FloatField, class UintField>
VR_HD void each_shadow_field(Request& x, FloatField f, UintField u) {
    constexpr uint32_t kUse = kWholePath;
    struct {
        uint32_t f = 0, u = 0;
    } column;
    VR_SHADOW_FIELDS(VR_VISIT_FIELD)
}
constexpr ColumnCount shadow_columns(FeatureMask features) {
    struct {
        uint32_t f = 0, u = 0;
    } column;
    VR_SHADOW_FIELDS(VR_COUNT_FIELD)
    return {column.f, column.u};
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
    TexturePoint<L> uv;          // kTextures
};

}  // namespace veriray
