// What a block of the fused launch does. Device code alone, so that it can be compiled at run time
// as well (run_time/kernel.cuh).
#pragma once

#include "backends/block_ledger.cuh"
#include "backends/items.cuh"
#include "schedulers/walking.h"

namespace veriray {

inline constexpr uint32_t kFusedBlock = 128;
// Blocks that a multiprocessor is to hold; 0: as many as it can.
template <FeatureMask kMask>
inline constexpr uint32_t kFusedBlocks =
    kSlim<kMask>                                                       ? kWalkBlocks
    : few_kinds(kinds_of(kMask)) && !(kMask & (kBvh | kMedia | kWide)) ? kFlatBlocks
                                                                       : 0;

// kExact: the scene has all features of the tracer.
template <class Tracer, bool kExact = false>
__device__ __forceinline__ void trace_fused(const SceneView& scene, const Job& job,
                                            const FusedItems& items, Control* control,
                                            uint64_t* ledger) {
    __shared__ PixelSum sums[kFusedBlock];
    __shared__ BlockLedger counts;
    counts.clear();
    __shared__ Stock stocks[kFusedBlock / 32];
    __shared__ EndedSample ended_samples[kFusedBlock];
    const uint32_t warp = threadIdx.x / 32;
    PixelSum& sum = sums[threadIdx.x];
    sum = PixelSum{};
    Stock& stock = stocks[warp];
    if (threadIdx.x % 32 == 0) stock = {};
    fill_block_quads<Tracer::kMask>(scene);
    __syncthreads();
    const auto take = [&](bool asks) { return take_items(stock, control, items.count, asks); };
    const auto add = [&](bool ended, const Spectrum<float>& sample) {
        if (!job.shared.numbers)
            add_together(sums + warp * 32, ended_samples + warp * 32, ended, sample);
    };
    const auto record = [&](uint32_t depth, uint32_t column) {
        counts.record(ledger, depth, column);
    };
    const auto run_flat = [&](auto take_one, auto add_one) {
        run_fused<typename Tracer::template With<Tracer::kMask & ~kBvh>>(scene, job, items, sum,
                                                                         take_one, add_one, record);
    };
    if constexpr (kExact && (Tracer::kMask & kBvh))
        run_walking<Tracer>(scene, job, items, sum, take, add, record);
    else if ((Tracer::kMask & kBvh) && (scene.features & kBvh))
        run_walking<Tracer>(scene, job, items, sum, take, add, record);
    else if constexpr (kInStep<Tracer>)
        run_flat(take, add);
    else
        run_flat([&](bool asks) { return asks ? take_item(control, items.count) : items.count; },
                 [&](bool ended, const Spectrum<float>& sample) {
                     if (ended && !job.shared.numbers) add_sample(sum, sample);
                 });
    __syncthreads();
    counts.add_to(ledger);
}

}  // namespace veriray
