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

// take() -> next item, or count when none is left or the render is cancelled.
// record(depth, column) counts one event of the ledger.
template <uint32_t kFeatures, class Take, class Record>
VR_HD void run_fused(const SceneView& scene, const Job& job, const FusedItems& items, PixelSum& sum,
                     Take take, Record record) {
    using Tracer = PathTracer<Scalar, kFeatures>;
    PathState<Scalar> path;
    uint32_t sample = 0, sample_end = 0, depth = 0, pixel = 0;
    bool alive = false;
    for (;;) {
        if (!alive) {
            if (sample == sample_end) {
                if (sample_end) flush(job.film, pixel, sum);
                const uint64_t item = take();
                if (item >= items.count) return;
                const uint64_t run = item / job.pixels();
                pixel = job.pixel(static_cast<uint32_t>(item - run * job.pixels()));
                sample = static_cast<uint32_t>(run) * items.samples_per_item;
                sample_end = sample + items.samples_per_item;
                if (sample_end > job.samples) sample_end = job.samples;
            }
            path = Tracer::begin(scene, job.settings, pixel % job.film.width,
                                 pixel / job.film.width, job.film.width, job.sample_begin + sample);
            depth = 0;
        }
        const Events<Scalar> e = Tracer::bounce(scene, job.settings, path, depth, true);
        if (e.visible) record(depth, kShadowVisible);
        if (e.occluded) record(depth, kShadowOccluded);
        alive = e.alive;
        if (!alive) {
            record(depth, finish<kFeatures>(scene, job, path, cause_of(e), sum));
            ++sample;
        }
        ++depth;
    }
}

}  // namespace veriray
