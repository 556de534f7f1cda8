// How the threads of the fused launch come by their work, and where its samples go.
#pragma once

#include "schedulers/fused.h"

namespace veriray {
namespace {

// Device words shared by the launches of one render.
struct Control {
    unsigned long long next;  // items handed out
    uint32_t cancel;
};

// Items that a warp has taken but not handed to its lanes: those that ask at a time are few, and
// one atomic addition a request is more than the memory can do.
struct Stock {
    uint64_t next, end;
};

// One item for one lane; see FusedLane.
__device__ uint64_t take_item(Control* control, uint64_t count) {
    if (*reinterpret_cast<volatile uint32_t*>(&control->cancel)) return kNoItems;
    const uint64_t item = atomicAdd(&control->next, 1ull);
    return item < count ? item : kNoItems;
}

// Items for the lanes of a warp that ask; all call it.
__device__ uint64_t take_items(Stock& stock, Control* control, uint64_t count, bool asks) {
    constexpr uint32_t kAll = ~0u, kRefill = 64;
    const uint32_t asking = __ballot_sync(kAll, asks);
    if (!asking) return count;
    const uint32_t lane = threadIdx.x & 31u, leader = __ffs(static_cast<int>(asking)) - 1,
                   wanted = __popc(asking), place = __popc(asking & ((1u << lane) - 1u));
    const Stock had = stock;
    const uint32_t left = static_cast<uint32_t>(had.end - had.next), given = min(left, wanted);
    Stock now{had.next + given, had.end};
    uint64_t refill = count;
    if (given < wanted && had.next < count) {
        // Towards its end, judged by its own last item, a warp takes no more than it needs.
        const uint64_t last = 2ull * gridDim.x * blockDim.x;
        const uint32_t size = had.next + last < count ? kRefill : wanted - given;
        if (lane == leader && !*reinterpret_cast<volatile uint32_t*>(&control->cancel))
            refill = atomicAdd(&control->next, static_cast<unsigned long long>(size));
        refill = __shfl_sync(kAll, refill, static_cast<int>(leader));
        now = {refill + (wanted - given), refill + size};
    }
    __syncwarp();  // all have read the stock
    if (lane == leader) stock = now;
    __syncwarp();
    if (asking == kAll && (given ? had.next : refill) >= count) return kNoItems;
    return place < given ? had.next + place : refill + (place - given);
}

// A warp's samples on their way to its lanes' sums.
struct EndedSample {
    float x[3];
    uint32_t lane;
};

// Adds the samples of lanes that have `ended` to their sums; all of a warp call it. Few end at a
// time, so each lane takes one channel of any of them.
__device__ void add_together(PixelSum* sums, EndedSample* list, bool ended,
                             const Spectrum<float>& sample) {
    const uint32_t all = __ballot_sync(~0u, ended);
    if (!all) return;
    const uint32_t lane = threadIdx.x & 31u, channels = 3u * __popc(all);
    if (ended) list[__popc(all & ((1u << lane) - 1u))] = {{sample[0], sample[1], sample[2]}, lane};
    __syncwarp();
    for (uint32_t i = lane; i < channels; i += 32) {
        const EndedSample& from = list[i / 3];
        add_sample(sums[from.lane], static_cast<int>(i % 3), from.x[i % 3]);
    }
    __syncwarp();
}

}  // namespace
}  // namespace veriray
