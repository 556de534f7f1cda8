// Scheduler `thrust`: Algorithm 1 of H. Dahlberg, "Parallel Path Tracing in CUDA", KTH, 2016.
// An array of paths and one of their indices; every bounce is one launch of ceil(live / 256)
// blocks over the live indices, ended paths write -1 over theirs, and thrust::remove_if closes the
// gaps before the next bounce. Other ways to close them are there to be compared.
#pragma once

#include <thrust/copy.h>
#include <thrust/count.h>
#include <thrust/partition.h>
#include <thrust/remove.h>

#include <algorithm>
#include <utility>
#include <vector>

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
template <uint32_t kFeatures>
VR_HD void thrust_begin(const SceneView& scene, const Job& job, const Columns& paths,
                        int32_t* indices, uint64_t first, uint32_t i) {
    store_path<kFeatures>(paths, i,
                          begin_path<kFeatures>(scene, job, static_cast<uint32_t>(first + i)));
    indices[i] = static_cast<int32_t>(i);
}

// Body of a bounce: the path whose index stands at place k.
template <uint32_t kFeatures>
VR_HD BounceOutcome thrust_bounce(const SceneView& scene, const Job& job, const Columns& paths,
                                  const PathIndices& indices, Compaction compaction, uint32_t depth,
                                  uint32_t k) {
    if (compaction == Compaction::kNone && indices.now[k] < 0) return {kLive, kLive};
    const uint32_t i = static_cast<uint32_t>(indices.now[k]);
    PathState<Scalar> path = load_path<kFeatures>(paths, i);
    const Events<Scalar> e =
        PathTracer<Scalar, kFeatures>::bounce(scene, job.settings, path, depth, true);
    BounceOutcome out{cause_of(e), kLive};
    if (e.visible) out.shadow = kShadowVisible;
    if (e.occluded) out.shadow = kShadowOccluded;
    if (e.alive) {
        store_path<kFeatures>(paths, i, path);
        if (compaction == Compaction::kAppend)
            indices.next[atomic_next(indices.appended)] = static_cast<int32_t>(i);
    } else {
        out.cause = end_path<kFeatures>(scene, job, path, out.cause);
        indices.now[k] = -1;
    }
    return out;
}

struct IsDead {
    VR_HD bool operator()(int32_t index) const { return index < 0; }
};
struct IsLive {
    VR_HD bool operator()(int32_t index) const { return index >= 0; }
};

// Closes the gaps in the first n indices; returns the live ones.
template <class Exec>
uint32_t compact(Exec& exec, PathIndices& indices, Compaction compaction, uint32_t n) {
    int32_t *const first = indices.now, *const last = first + n;
    if (compaction == Compaction::kNone)
        return static_cast<uint32_t>(thrust::count_if(exec.policy(), first, last, IsLive()));
    if (compaction == Compaction::kRemoveIf)
        return static_cast<uint32_t>(thrust::remove_if(exec.policy(), first, last, IsDead()) -
                                     first);
    if (compaction == Compaction::kPartition)
        return static_cast<uint32_t>(thrust::partition(exec.policy(), first, last, IsLive()) -
                                     first);
    std::swap(indices.now, indices.next);
    if (compaction == Compaction::kAppend) return exec.appended(indices.appended);
    return static_cast<uint32_t>(
        thrust::copy_if(exec.policy(), first, last, indices.now, IsLive()) - indices.now);
}

// What each depth cost, summed over the passes.
struct DepthCosts {
    std::vector<uint64_t>& blocks;
    std::vector<double>&seconds, &compaction;  // in all; of that, closing gaps
};

// Exec: begin(indices, first, n), bounce(indices, depth, n), policy(), appended(counter) -> count,
// clock() -> seconds, poll(fraction).
template <class Exec>
void run_thrust(Exec& exec, uint64_t paths, const PathPool& pool, const DepthCosts& costs) {
    const uint32_t slots = pool.paths.capacity;
    const Compaction compaction = pool.compaction;
    PathIndices indices = pool.indices;
    for (uint64_t first = 0; first < paths; first += slots) {
        const uint32_t begun = static_cast<uint32_t>(paths - first < slots ? paths - first : slots);
        uint32_t live = begun, launched = begun;
        exec.begin(indices, first, live);
        for (uint32_t depth = 0; live; ++depth) {
            if (costs.blocks.size() <= depth) {
                costs.blocks.push_back(0);
                costs.seconds.push_back(0);
                costs.compaction.push_back(0);
            }
            costs.blocks[depth] += (launched + kThrustBlock - 1) / kThrustBlock;
            const double start = exec.clock();
            exec.bounce(indices, depth, launched);
            const double middle = exec.clock();
            live = compact(exec, indices, compaction, launched);
            if (compaction != Compaction::kNone) launched = live;
            const double end = exec.clock();
            costs.seconds[depth] += end - start;
            costs.compaction[depth] += end - middle;
            const uint64_t done = first + begun - live;
            if (!exec.poll(static_cast<double>(done) / static_cast<double>(paths))) return;
        }
    }
}

}  // namespace veriray
