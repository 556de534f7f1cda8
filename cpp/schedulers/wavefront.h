// Scheduler `wavefront`: a wave of paths in memory that moves on by a segment at a step. Every
// stage is a launch of its own over a queue of slots, which the stage before it has filled by
// appending; the counts stay with the queues. A step:
//   refill   a slot whose path has ended begins the job's next one; queue `live`
//   trace    the closest hit of each path; a queue by kind of what was hit, or one for all
//   scatter  from the hit to the next ray; shadow rays to queue `shadows`
//   shadow   shadow rays, which deliver where they are free
// A path that ends at a hit with a shadow ray under way is finished when that is back: radiance is
// summed in the order of PathTracer::bounce. Before a stage, the queues that it fills are empty.
// S. Laine, T. Karras and T. Aila, "Megakernels considered harmful: wavefront path tracing on
// GPUs", 2013; refilled as in J. Novak, V. Havran and C. Dachsbacher, "Path regeneration for
// interactive path tracing", 2010.
#pragma once

#include <utility>

#include "schedulers/columns.h"

namespace veriray {

inline constexpr uint32_t kHitKinds = 1 + kMaterialCount;  // nothing, or a material
inline constexpr uint32_t kKindPlaces = 32;                // of a kind together: no warp mixes them

struct WaveCounts {
    uint32_t begun;  // paths of the job
    uint32_t live, hits[kHitKinds], shadows;
    uint32_t traced;   // paths of the last step; 0: the job is done
    uint32_t stopped;  // no path goes on
};

struct Wave {
    Columns paths;                    // by slot
    Columns requests;                 // by place in `shadows`
    float* distance;                  // hits, by slot
    uint32_t *primitive, *state;      // by slot
    uint32_t *live, *shadows, *hits;  // queues: slots; [kind][capacity]
    WaveCounts* counts;
    uint32_t capacity, kinds;  // kHitKinds, or 1: not sorted

    // The state of a slot: its path's segment, and the cause of its end where that waits for a
    // shadow ray; or kFree, whose successor is segment 0.
    static constexpr uint32_t kFree = ~0u, kCauseShift = 20;
    static_assert(kHardMaxDepth >> kCauseShift == 0);
};

// Columns that a wave needs: floats and uints by slot.
constexpr uint32_t wave_floats(uint32_t features) {
    return path_floats(features) + kShadowFloats + 1;
}
constexpr uint32_t wave_uints(uint32_t features, uint32_t kinds) {
    return path_uints(features) + shadow_uints(features) + 4 + kinds;
}

// Lays a wave out in memory of that many columns. States must be kFree and counts 0.
inline Wave make_wave(uint32_t features, uint32_t kinds, uint32_t capacity, float* floats,
                      uint32_t* uints, WaveCounts* counts) {
    const auto take = [&](auto*& from, size_t columns) {
        return std::exchange(from, from + columns * capacity);
    };
    Wave w{};
    w.paths = {take(floats, path_floats(features)), take(uints, path_uints(features)), capacity};
    w.requests = {take(floats, kShadowFloats), take(uints, shadow_uints(features)), capacity};
    w.distance = take(floats, 1);
    w.primitive = take(uints, 1);
    w.state = take(uints, 1);
    w.live = take(uints, 1);
    w.shadows = take(uints, 1);
    w.hits = take(uints, kinds);
    w.counts = counts;
    w.capacity = capacity;
    w.kinds = kinds;
    return w;
}

// ---- refill: slot i ----
template <uint32_t kFeatures>
VR_HD void wave_refill(const SceneView& scene, const Job& job, const Wave& w, uint32_t i) {
    const uint32_t state = w.state[i];
    bool lives = state != Wave::kFree;
    // The counter passes the number of paths by less than a wave.
    if (!lives && atomic_load(&w.counts->begun) < job.paths()) {
        const uint32_t g = atomic_next(&w.counts->begun);
        lives = g < job.paths();
        if (lives) store_path<kFeatures>(w.paths, i, begin_path<kFeatures>(scene, job, g));
    }
    if (!lives) return;
    w.state[i] = state + 1;
    w.live[atomic_next(&w.counts->live)] = i;
}

// ---- trace: place k of `live` ----
template <uint32_t kFeatures>
VR_HD uint32_t kind_of(const SceneView& scene, const Hit<Scalar>& hit) {
    using Tracer = PathTracer<Scalar, kFeatures>;
    if (!(hit.t < kInfinity)) return 0;
    if constexpr (Tracer::Material::kDiffuseOnly) return 1;
    uint32_t row = hit.primitive;
    if constexpr (Tracer::has(kBvh))
        if (scene.surface_of) row = scene.surface_of[row];
    return 1 + to_uint(Tracer::surface_column(scene, row, kSurfaceKind));
}

template <uint32_t kFeatures>
VR_HD void wave_trace(const SceneView& scene, const Wave& w, uint32_t k) {
    const uint32_t i = w.live[k];
    const Columns& c = w.paths;
    const Ray<Scalar> ray{{c.f(0, i), c.f(1, i), c.f(2, i)}, {c.f(3, i), c.f(4, i), c.f(5, i)}};
    const Hit<Scalar> hit = PathTracer<Scalar, kFeatures>::closest(scene, ray, kInfinity, true);
    w.distance[i] = hit.t;
    w.primitive[i] = hit.primitive;
    const uint32_t kind = w.kinds == 1 ? 0 : kind_of<kFeatures>(scene, hit);
    const uint32_t place = atomic_next(w.counts->hits, kind);
    w.hits[static_cast<uint64_t>(kind) * w.capacity + place] = i;
}

// ---- scatter: place k of the queues of hits, laid end to end, each rounded up to kKindPlaces ----
VR_HD uint32_t hit_places(const Wave& w, uint32_t kind) {
    return (w.counts->hits[kind] + kKindPlaces - 1) / kKindPlaces * kKindPlaces;
}
VR_HD uint32_t hit_places(const Wave& w) {
    uint32_t places = 0;
    for (uint32_t kind = 0; kind < w.kinds; ++kind) places += hit_places(w, kind);
    return places;
}

// record(depth, column) counts one event of the ledger.
template <uint32_t kFeatures, class Record>
VR_HD void wave_scatter(const SceneView& scene, const Job& job, const Wave& w, uint32_t k,
                        Record record) {
    uint32_t kind = 0;
    for (; k >= hit_places(w, kind); ++kind) k -= hit_places(w, kind);
    if (k >= w.counts->hits[kind]) return;
    const uint32_t i = w.hits[static_cast<uint64_t>(kind) * w.capacity + k];
    const uint32_t segment = w.state[i];
    PathState<Scalar> path = load_path<kFeatures>(w.paths, i);
    ShadowRequest<Scalar> shadow{};
    const LedgerColumn cause = cause_of(PathTracer<Scalar, kFeatures>::scatter(
        scene, job.settings, path, {w.distance[i], w.primitive[i]}, segment, true, shadow));
    if (shadow.wanted) {
        const uint32_t place = atomic_next(&w.counts->shadows);
        w.shadows[place] = i;
        each_shadow_field<kFeatures>(
            shadow, [&](uint64_t c, float x) { w.requests.f(c, place) = x; },
            [&](uint64_t c, uint32_t x) { w.requests.u(c, place) = x; });
    }
    if (cause == kLive || shadow.wanted) {
        store_path<kFeatures>(w.paths, i, path, true);
        if (cause != kLive) w.state[i] = segment | cause << Wave::kCauseShift;
    } else {
        record(segment, end_path<kFeatures>(scene, job, path, cause));
        w.state[i] = Wave::kFree;
    }
}

// ---- shadow: place k of `shadows` ----
template <uint32_t kFeatures, class Record>
VR_HD void wave_shadow(const SceneView& scene, const Job& job, const Wave& w, uint32_t k,
                       Record record) {
    using Tracer = PathTracer<Scalar, kFeatures>;
    ShadowRequest<Scalar> shadow{};
    each_shadow_field<kFeatures>(
        shadow, [&](uint64_t c, float& x) { x = w.requests.f(c, k); },
        [&](uint64_t c, uint32_t& x) { x = w.requests.u(c, k); });
    shadow.wanted = true;
    const bool free = Tracer::unblocked(scene, shadow);
    const uint32_t i = w.shadows[k], state = w.state[i];
    const uint32_t segment = state & ((1u << Wave::kCauseShift) - 1);
    const LedgerColumn cause = static_cast<LedgerColumn>(state >> Wave::kCauseShift);
    record(segment, free ? kShadowVisible : kShadowOccluded);
    if (!free && cause == kLive) return;
    PathState<Scalar> path{};
    float* const radiance = &w.paths.f(kRadianceField, i);
    const uint64_t next = w.capacity;
    path.radiance = {radiance[0], radiance[next], radiance[2 * next]};
    Tracer::visible(path, shadow, free);
    if (cause == kLive) {
        radiance[0] = path.radiance.x;
        radiance[next] = path.radiance.y;
        radiance[2 * next] = path.radiance.z;
    } else {
        path.pixel = w.paths.u(kPixelField, i);
        path.sample = w.paths.u(kSampleField, i);
        record(segment, end_path<kFeatures>(scene, job, path, cause));
        w.state[i] = Wave::kFree;
    }
}

}  // namespace veriray
