// What the launches of scheduler `thrust` do to one path.
#pragma once

#include "schedulers/columns.h"

namespace veriray {

inline constexpr uint32_t kThrustBlock = 256;

// The index array.
struct PathIndices {
    int32_t* now;
    int32_t* next;       // kCopy, kAppend: the other half
    uint32_t* appended;  // kAppend: entries in next
};

// The paths in flight and their indices.
struct PathPool {
    Columns paths;
    PathIndices indices;
    Compaction compaction;
};

// Slots of a pool: `batch`, or, if that is 0, one a pixel up to 2^22.
inline uint32_t pool_slots(uint64_t batch, const Job& job) {
    const uint64_t wanted = batch ? batch : std::min<uint64_t>(job.pixels(), 1u << 22);
    return static_cast<uint32_t>(std::min(wanted, job.paths()));
}
constexpr uint32_t index_columns(Compaction compaction) {
    return compaction == Compaction::kCopy || compaction == Compaction::kAppend ? 2 : 1;
}

// Lays a pool out in memory of path_floats, path_uints and index_columns columns of that many
// slots, and a counter.
inline PathPool make_pool(Compaction compaction, uint32_t slots, float* floats, uint32_t* uints,
                          int32_t* index, uint32_t* appended) {
    int32_t* const next = index_columns(compaction) == 2 ? index + slots : nullptr;
    return {{floats, uints, slots}, {index, next, appended}, compaction};
}

// What one path did in one launch, for the ledger.
struct BounceOutcome {
    LedgerColumn cause;   // kLive: goes on
    LedgerColumn shadow;  // kLive: no shadow ray
};

// Body of the first launch: path `first + i` of the job begins in slot i.
template <class Tracer>
VR_HD void thrust_begin(const SceneView& scene, const Job& job, const Columns& paths,
                        int32_t* indices, uint64_t first, uint32_t i) {
    store_path<Tracer>(paths, i, begin_path<Tracer>(scene, job, static_cast<uint32_t>(first + i)));
    indices[i] = static_cast<int32_t>(i);
}

// Body of a bounce: the path whose index stands at place k.
template <class Tracer>
VR_HD BounceOutcome thrust_bounce(const SceneView& scene, const Job& job, const Columns& paths,
                                  const PathIndices& indices, Compaction compaction, uint32_t depth,
                                  uint32_t k) {
    if (compaction == Compaction::kNone && indices.now[k] < 0) return {kLive, kLive};
    const uint32_t i = static_cast<uint32_t>(indices.now[k]);
    typename Tracer::State path = load_path<Tracer>(paths, i);
    const Events<Scalar> e = bounce<Tracer>(scene, job.settings, path, depth, true);
    BounceOutcome out{cause_of(e), kLive};
    if (e.visible) out.shadow = kShadowVisible;
    if (e.occluded) out.shadow = kShadowOccluded;
    if (e.alive) {
        store_path<Tracer>(paths, i, path);
        if (compaction == Compaction::kAppend)
            indices.next[atomic_next(indices.appended)] = static_cast<int32_t>(i);
    } else {
        out.cause = end_path<Tracer>(scene, job, path, out.cause);
        indices.now[k] = -1;
    }
    return out;
}

}  // namespace veriray
