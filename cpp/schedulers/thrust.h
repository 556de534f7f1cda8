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

#include "schedulers/thrust_bodies.h"

namespace veriray {

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
