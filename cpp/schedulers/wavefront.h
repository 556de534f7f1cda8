// Scheduler `wavefront`: a wave of paths in memory that moves on by a segment at a step. Every
// stage is a launch of its own over a queue of slots, which the stage before it has filled by
// appending:
//   refill   slots whose path has ended begin the job's next ones; queue `live`
//   trace    the closest hit of each path; a queue by kind of what was hit, or one for all
//   scatter  from the hit to the next ray; shadow rays to queue `shadows`
//   shadow   shadow rays, which deliver where they are free
// A wave is cut into tiles of slots with queues of their own: a tile is a block's, so that counts
// are shared memory's and no word is wanted by the whole device. A path that ends at a hit with a
// shadow ray under way is finished when that is back: radiance is summed in the order of
// `bounce`.
// S. Laine, T. Karras and T. Aila, "Megakernels considered harmful: wavefront path tracing on
// GPUs", 2013; refilled as in J. Novak, V. Havran and C. Dachsbacher, "Path regeneration for
// interactive path tracing", 2010.
#pragma once

#include <utility>

#include "schedulers/columns.h"

namespace veriray {

inline constexpr uint32_t kTileSlots = 512;
inline constexpr uint32_t kPart = 128;  // places of a tile that a warp takes at once
inline constexpr uint32_t kTileParts = kTileSlots / kPart;
inline constexpr uint32_t kHitKinds = 1 + kMaterialCount;  // nothing, or a material
inline constexpr uint32_t kKindPlaces = 32;  // of a kind side by side: no warp mixes them

// Entries of a tile's queues.
struct TileQueues {
    uint32_t live, ended, hits[kHitKinds], shadows;
    uint32_t idle;  // no path is left to the tile
};
struct WaveControl {
    uint64_t begun;          // paths of the job; may pass their number
    uint32_t idle, stopped;  // tiles that are; by the host: no path goes on
    // Of this step, where warps share the queues of all tiles: parts that hold paths, and those of
    // them that have been taken to be traced and for shadow rays.
    uint32_t parts, traced, shadowed;
};

struct Wave {
    Columns paths;                            // by slot
    Columns requests;                         // shadow rays, by place in `shadows`
    float* distance;                          // of hits, by slot
    uint32_t *primitive, *state;              // by slot
    uint32_t *live, *ended, *shadows, *hits;  // slots; a tile's from its first slot on; [kind]
    uint32_t* parts;                          // CUDA: first places in `live`, kTileParts a tile
    TileQueues* queues;                       // by tile
    WaveControl* control;
    uint32_t capacity, kinds;  // slots; kHitKinds, or 1: not sorted

    // The state of a slot: its path's segment, and the cause of its end where that waits for a
    // shadow ray; or kFree.
    static constexpr uint32_t kFree = ~0u, kCauseShift = 20;
    static_assert(kHardMaxDepth >> kCauseShift == 0);

    VR_HD uint32_t slots(uint32_t first) const {
        return capacity - first < kTileSlots ? capacity - first : kTileSlots;
    }
};

constexpr uint32_t tile_count(uint32_t capacity) {
    return (capacity + kTileSlots - 1) / kTileSlots;
}
// Columns that a wave needs, by slot.
constexpr ColumnCount wave_columns(ColumnCount path, ColumnCount request, uint32_t kinds) {
    return {path.floats + request.floats + 1, path.uints + request.uints + 5 + kinds};
}

// Lays a wave out in memory of that many columns. States must become kFree, queues and control 0.
inline Wave make_wave(ColumnCount path, ColumnCount request, uint32_t kinds, uint32_t capacity,
                      float* floats, uint32_t* uints, TileQueues* queues, WaveControl* control) {
    const auto take = [&](auto*& from, size_t columns) {
        return std::exchange(from, from + columns * capacity);
    };
    Wave w{};
    w.paths = {take(floats, path.floats), take(uints, path.uints), capacity};
    w.requests = {take(floats, request.floats), take(uints, request.uints), capacity};
    w.distance = take(floats, 1);
    for (uint32_t** column : {&w.primitive, &w.state, &w.live, &w.ended, &w.shadows})
        *column = take(uints, 1);
    w.hits = uints;
    w.queues = queues;
    w.control = control;
    w.capacity = capacity;
    w.kinds = kinds;
    return w;
}

// In what follows `first` is a tile's first slot and q its queues.

// ---- refill: all slots i of a tile, then once, then all paths k that begin ----
VR_HD void wave_sweep(const Wave& w, TileQueues& q, uint32_t first, uint32_t i) {
    const uint32_t state = w.state[i];
    if (state == Wave::kFree) {
        w.ended[first + atomic_next(&q.ended)] = i;
    } else {
        w.state[i] = state + 1;
        w.live[first + atomic_next(&q.live)] = i;
    }
}

struct Refill {
    uint64_t path;  // of the job, the first to begin
    uint32_t begins, survivors;
};
VR_HD Refill wave_take(const Job& job, const Wave& w, TileQueues& q) {
    Refill r{0, 0, q.live};
    if (q.ended) r.path = atomic_add(&w.control->begun, q.ended);
    if (r.path < job.paths())
        r.begins =
            job.paths() - r.path < q.ended ? static_cast<uint32_t>(job.paths() - r.path) : q.ended;
    if (atomic_load(&w.control->stopped)) r.begins = r.survivors = 0;
    q.live = r.survivors + r.begins;
    q.idle = q.live == 0;
    if (q.idle) atomic_next(&w.control->idle);
    return r;
}

template <class Tracer>
VR_HD void wave_begin(const SceneView& scene, const Job& job, const Wave& w, const Refill& r,
                      uint32_t first, uint32_t k) {
    const uint32_t i = w.ended[first + k];
    store_path<Tracer>(w.paths, i,
                       begin_path<Tracer>(scene, job, static_cast<uint32_t>(r.path + k)));
    w.state[i] = 0;
    w.live[first + r.survivors + k] = i;
}

// ---- trace: place k of `live` ----
// What the path of slot i has met.
VR_HD void wave_meets(const Wave& w, uint32_t i, const Hit<Scalar>& hit) {
    w.distance[i] = hit.t;
    w.primitive[i] = hit.primitive;
}
// Walker: the tracer that looks for the hit.
template <class Tracer, class Walker = Tracer>
VR_HD void wave_trace(const SceneView& scene, const Wave& w, uint32_t first, uint32_t k) {
    const uint32_t i = w.live[first + k];
    const typename Tracer::State path = load_path<Tracer, kAhead>(w.paths, i);
    wave_meets(w, i, Walker::next_hit(scene, path, kInfinity, true));
}

// ---- sort: place k of `live` ----
template <class Tracer>
VR_HD void wave_sort(const SceneView& scene, const Wave& w, TileQueues& q, uint32_t first,
                     uint32_t k) {
    const uint32_t i = w.live[first + k];
    const uint32_t kind =
        w.kinds == 1 ? 0 : Tracer::kind_of(scene, {w.distance[i], w.primitive[i]});
    const uint32_t place = first + atomic_next(q.hits, kind);
    w.hits[static_cast<uint64_t>(kind) * w.capacity + place] = i;
}

// ---- scatter: place k of a kind's queue of hits ----
// Laid end to end, the queues of a tile have hit_places(q); each is rounded up to kKindPlaces.
VR_HD uint32_t hit_places(const TileQueues& q, uint32_t kind) {
    return (q.hits[kind] + kKindPlaces - 1) / kKindPlaces * kKindPlaces;
}
VR_HD uint32_t hit_places(const TileQueues& q) {
    uint32_t places = 0;
    for (uint32_t kind = 0; kind < kHitKinds; ++kind) places += hit_places(q, kind);
    return places;
}

// Place k of these as one of its kind's queue; false where there is none.
VR_HD bool find_hit(const TileQueues& q, uint32_t& kind, uint32_t& k) {
    for (kind = 0; k >= hit_places(q, kind); ++kind) k -= hit_places(q, kind);
    return k < q.hits[kind];
}

// record(depth, column) counts one event of the ledger.
template <class Tracer, class Record>
VR_HD void wave_scatter(const SceneView& scene, const Job& job, const Wave& w, TileQueues& q,
                        uint32_t first, uint32_t kind, uint32_t k, Record record) {
    const uint32_t i = w.hits[static_cast<uint64_t>(kind) * w.capacity + first + k];
    const uint32_t segment = w.state[i];
    typename Tracer::State path = load_path<Tracer>(w.paths, i);
    typename Tracer::Request shadow{};
    const Events<Scalar> e = Tracer::scatter(
        scene, job.settings, path, {w.distance[i], w.primitive[i]}, segment, true, shadow);
    const LedgerColumn cause = cause_of(e);
    if (e.occluded) record(segment, kShadowOccluded);
    if (shadow.wanted) {
        const uint32_t place = first + atomic_next(&q.shadows);
        w.shadows[place] = i;
        Tracer::each_request_field(
            shadow, [&](uint64_t c, float x) { w.requests.f(c, place) = x; },
            [&](uint64_t c, uint32_t x) { w.requests.u(c, place) = x; });
    }
    if (cause == kLive || shadow.wanted) {
        store_path<Tracer, kWholePath & ~kFixed>(w.paths, i, path);
        if (cause != kLive) w.state[i] = segment | cause << Wave::kCauseShift;
    } else {
        record(segment, end_path<Tracer>(scene, job, path, cause));
        w.state[i] = Wave::kFree;
    }
}

// ---- shadow: place k of `shadows` ----
template <class Tracer>
VR_HD typename Tracer::Request wave_request(const Wave& w, uint32_t first, uint32_t k) {
    typename Tracer::Request shadow = Tracer::no_request(true);
    Tracer::each_request_field(
        shadow, [&](uint64_t c, float& x) { x = w.requests.f(c, first + k); },
        [&](uint64_t c, uint32_t& x) { x = w.requests.u(c, first + k); });
    shadow.wanted = true;
    return shadow;
}
// Delivers it where it is free, and finishes its path if that has ended.
template <class Tracer, class Record>
VR_HD void wave_deliver(const SceneView& scene, const Job& job, const Wave& w, uint32_t first,
                        uint32_t k, const typename Tracer::Request& shadow, bool free,
                        Record record) {
    const uint32_t i = w.shadows[first + k], state = w.state[i];
    const uint32_t segment = state & ((1u << Wave::kCauseShift) - 1);
    const LedgerColumn cause = static_cast<LedgerColumn>(state >> Wave::kCauseShift);
    record(segment, free ? kShadowVisible : kShadowOccluded);
    if (!free && cause == kLive) return;
    typename Tracer::State path = load_path<Tracer, kGathered>(w.paths, i);
    Tracer::visible(path, shadow, free);
    if (cause == kLive) {
        store_path<Tracer, kGathered>(w.paths, i, path);
    } else {
        load_fields<Tracer, kFixed>(w.paths, i, path);
        record(segment, end_path<Tracer>(scene, job, path, cause));
        w.state[i] = Wave::kFree;
    }
}

template <class Tracer, class Walker = Tracer, class Record>
VR_HD void wave_shadow(const SceneView& scene, const Job& job, const Wave& w, uint32_t first,
                       uint32_t k, Record record) {
    typename Tracer::Request shadow = wave_request<Tracer>(w, first, k);
    const bool free = Walker::unblocked(scene, shadow);
    wave_deliver<Tracer>(scene, job, w, first, k, shadow, free, record);
}

// All steps of a tile: what CUDA does by launches.
template <class Tracer, class Record>
void run_wave_tile(const SceneView& scene, const Job& job, const Wave& w, uint32_t tile,
                   Record record) {
    const uint32_t first = tile * kTileSlots, slots = w.slots(first);
    for (;;) {
        TileQueues q{};
        for (uint32_t k = 0; k < slots; ++k) wave_sweep(w, q, first, first + k);
        const Refill r = wave_take(job, w, q);
        if (q.idle) return;
        for (uint32_t k = 0; k < r.begins; ++k) wave_begin<Tracer>(scene, job, w, r, first, k);
        for (uint32_t k = 0; k < q.live; ++k) wave_trace<Tracer>(scene, w, first, k);
        for (uint32_t k = 0; k < q.live; ++k) wave_sort<Tracer>(scene, w, q, first, k);
        for (uint32_t kind = 0; kind < w.kinds; ++kind)
            for (uint32_t k = 0; k < q.hits[kind]; ++k)
                wave_scatter<Tracer>(scene, job, w, q, first, kind, k, record);
        for (uint32_t k = 0; k < q.shadows; ++k)
            wave_shadow<Tracer>(scene, job, w, first, k, record);
    }
}

}  // namespace veriray
