// Scheduler `fused` for CUDA: one persistent launch. A thread owns an item (a pixel and a run of
// samples); when its path ends it begins the next sample at once, so that warps stay full. The
// path's state never leaves the registers.
#pragma once

#include "schedulers/job.h"

namespace veriray {

struct FusedItems {
    uint64_t count;             // pixels times runs
    uint32_t samples_per_item;  // the last run may be shorter
};
inline constexpr uint64_t kNoItems = ~0ull;

// Lanes of a warp stay in step where bounces cost much the same; variants that hold media lose 6 %
// by it (H200).
template <class Tracer>
inline constexpr bool kInStep = (Tracer::kMask & kMedia) == 0;

// What a lane works on.
struct FusedLane {
    uint32_t pixel = 0, sample = 0, end = 0;

    VR_HD bool idle() const { return sample == end; }

    // A lane whose path has `ended` gets its next sample, or where its item is done a new one.
    // take(asks): lanes that ask get the next item. In step, the lanes of a warp call it together:
    // where no item is left, or the render is cancelled and the warp's stock used, it gives count
    // or more, and kNoItems to all lanes once all ask; out of step, kNoItems at once. Returns false
    // then.
    template <class Take>
    VR_HD bool serve(const Job& job, const FusedItems& items, bool ended, Take take,
                     PixelSum& sum) {
        const bool asks = ended && idle();
        const uint64_t item = take(asks);
        if (!asks) return true;
        if (end) job.add(pixel, sum);
        sample = end = 0;
        if (item < items.count) {
            const uint64_t run = item / job.pixels();
            pixel = job.pixel(static_cast<uint32_t>(item - run * job.pixels()));
            sample = static_cast<uint32_t>(run) * items.samples_per_item;
            end = sample + items.samples_per_item;
            if (end > job.samples) end = job.samples;
        }
        return item != kNoItems;
    }

    template <class Tracer>
    VR_HD typename Tracer::State begin(const SceneView& scene, const Job& job) const {
        const uint32_t width = job.width;
        return Tracer::begin(scene, job.settings, pixel % width, pixel / width, width,
                             job.sample_begin + sample);
    }
};

// add(ended, sample) adds to `sum` the samples of lanes whose path has ended; in step, the lanes of
// a warp call it together. record(depth, column) counts one event of the ledger.
template <class Tracer, class Take, class Add, class Record>
VR_HD void run_fused(const SceneView& scene, const Job& job, const FusedItems& items, PixelSum& sum,
                     Take take, Add add, Record record) {
    typename Tracer::State path;
    Spectrum<float> sample{};
    FusedLane lane;
    uint32_t depth = 0;
    bool alive = false;
    for (;;) {
        if (!lane.serve(job, items, !alive, take, sum)) return;
        const bool idle = lane.idle();
        if (!alive && !idle) {
            path = lane.template begin<Tracer>(scene, job);
            depth = 0;
        }
        if constexpr (kInStep<Tracer>) rejoin_warp();
        bool ended = false;
        if (!idle) {
            const Events<Scalar> e = bounce<Tracer>(scene, job.settings, path, depth, true);
            if (e.visible) record(depth, kShadowVisible);
            if (e.occluded) record(depth, kShadowOccluded);
            alive = e.alive;
            ended = !alive;
            if (ended) {
                record(depth, finish<Tracer>(scene, job, path, cause_of(e), sample));
                ++lane.sample;
            }
            ++depth;
        }
        add(ended, sample);
    }
}

}  // namespace veriray
