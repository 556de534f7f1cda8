// Feature images on CUDA. A warp takes 32 samples in the order of pixels; its lanes look at one
// each, and then sum the channels of its pixels.
#include <cuda_runtime.h>

#include "backends/cuda_objects.cuh"
#include "backends/features.h"
#include "backends/launches.cuh"
#include "integrators/features.h"

namespace veriray {
namespace {

constexpr uint32_t kFeatureBlock = 128, kWarps = kFeatureBlock / 32;

// What a warp has looked at: channels, then hits, by lane.
struct Looks {
    float values[kMostFeatureChannels + 1][33];
};

// whole: no other thread adds to the number.
__device__ void add_to(uint64_t* number, Fixed128 x, bool whole) {
    if (!whole) return add_to_number(number, x);
    auto* both = reinterpret_cast<ulonglong2*>(number);  // numbers begin at even words
    const ulonglong2 before = *both;
    add(x, {before.x, before.y});
    *both = {x.lo, x.hi};
}

// Adds a channel, or behind the last the hits, of those of the warp's items that are of a pixel.
__device__ void sum_channel(const FeatureJob& job, const Looks& looks, uint32_t pixel,
                            uint32_t channel, uint64_t first, uint64_t end) {
    const uint64_t from = uint64_t{pixel} * job.samples, to = from + job.samples;
    const bool whole = from >= first && to <= end;
    const float* values = looks.values[channel];
    const uint32_t last = static_cast<uint32_t>(min(to, end) - first);
    uint32_t k = from > first ? static_cast<uint32_t>(from - first) : 0u;
    if (channel == job.channels) {
        uint32_t hits = 0;
        for (; k < last; ++k) hits += values[k] != 0.f ? 1u : 0u;
        return add_to(job.hits.number(pixel, 0), {hits, 0}, whole);
    }
    uint32_t kind = 0;
    while (!(job.view.wanted >> kind & 1u) || channel < job.first[kind] ||
           channel >= job.first[kind] + job.planes[kind].channels)
        ++kind;
    PixelSum one{};
    for (; k < last; ++k) add_sample(one, 0, values[k]);
    uint64_t* number = job.planes[kind].number(pixel, channel - job.first[kind]);
    add_to(number, one.sum[0], whole);
    add_to(number + 2, one.square[0], whole);
}

// Items [begin, end): samples of pixels in their order.
template <class Looker>
__global__ void __launch_bounds__(kFeatureBlock)
    look_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ FeatureJob job,
                uint64_t begin, uint64_t end) {
    __shared__ Looks shared[kWarps];
    fill_block_quads<Looker::kMask>(scene);
    __syncthreads();
    Looks& looks = shared[threadIdx.x / 32];
    const uint32_t lane = threadIdx.x % 32;
    const uint64_t first = begin + (uint64_t{blockIdx.x} * kWarps + threadIdx.x / 32) * 32;
    const uint64_t item = first + lane;
    if (item < end) {
        const uint32_t pixel = static_cast<uint32_t>(item / job.samples);
        const uint32_t sample =
            job.sample_begin + static_cast<uint32_t>(item - uint64_t{pixel} * job.samples);
        auto path = Looker::begin(scene, job.settings, pixel % job.width,
                                  job.first_row + pixel / job.width, job.width, sample, false);
        const auto put = [&](FeatureKind kind, const float* x, bool met) {
            const PlaneView& plane = job.planes[kind];
            const bool good = met && feature_accepted(plane, x);
            if (met && !good) log_refused(job, kind, pixel, sample, x);
            for (uint32_t c = 0; c < plane.channels; ++c)
                looks.values[job.first[kind] + c][lane] = good ? x[c] * plane.scale : 0.f;
        };
        const bool met = Looker::look(scene, job.settings, job.view, path, true, put);
        looks.values[job.channels][lane] = met ? 1.f : 0.f;
    }
    __syncwarp();
    if (first >= end) return;
    const uint64_t last = min(first + 32, end);
    const uint32_t pixel = static_cast<uint32_t>(first / job.samples), rows = job.channels + 1;
    const uint32_t sums = (static_cast<uint32_t>((last - 1) / job.samples) - pixel + 1) * rows;
    for (uint32_t i = lane; i < sums; i += 32)
        sum_channel(job, looks, pixel + i / rows, i % rows, first, last);
}

template <class Looker>
__global__ void __launch_bounds__(kFeatureBlock)
    centre_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ FeatureJob job) {
    fill_block_quads<Looker::kMask>(scene);
    __syncthreads();
    const uint32_t pixel = blockIdx.x * kFeatureBlock + threadIdx.x;
    if (pixel >= job.pixels) return;
    const uint32_t id = Looker::primitive_at_centre(
        scene, job.settings, pixel % job.width, job.first_row + pixel / job.width, job.width, true);
    add_to_number(job.primitive.number(pixel, 0), {id, 0});
}

}  // namespace

bool run_features(const Scene& scene, const FeatureJob& asked, const std::vector<float>& maps,
                  const RenderSettings& s, RenderStats& stats, const Poll& poll) {
    constexpr uint64_t kPart = 1 << 26;  // items of a launch
    use_device(scene.impl->device);
    stats.device = "cuda:" + std::to_string(scene.impl->device);
    SceneView view = scene.impl->view;
    const Scratch<float> there(maps, "texture maps");
    if (!maps.empty()) view.uv = there.get();
    const Scratch<FaultLog> faults(1, "fault log");
    check(cudaMemset(faults.get(), 0, sizeof(FaultLog)), "features");
    FeatureJob job = asked;
    job.faults = faults.get();
    const uint64_t items = uint64_t{job.pixels} * job.samples;
    bool complete = true;
    for (uint64_t at = 0; at < items && complete; at += kPart) {
        const uint64_t end = std::min(items, at + kPart);
        with_feature_variant(needed(view), s.all_features, [&]<uint32_t kVariant>() {
            look_kernel<FeatureImages<Scalar, kVariant>>
                <<<blocks_for(end - at, kFeatureBlock), kFeatureBlock>>>(view, job, at, end);
        });
        check_launch("features");
        check(cudaStreamSynchronize(nullptr), "features");
        ++stats.launches;
        const double share = static_cast<double>(end) / static_cast<double>(items);
        complete = !poll || keeping_device([&] { return poll(share); });
    }
    if (complete && job.centres) {
        with_feature_variant(needed(view), s.all_features, [&]<uint32_t kVariant>() {
            centre_kernel<FeatureImages<Scalar, kVariant>>
                <<<blocks_for(job.pixels, kFeatureBlock), kFeatureBlock>>>(view, job);
        });
        check_launch("features");
        ++stats.launches;
    }
    check(cudaStreamSynchronize(nullptr), "features");
    *asked.faults = faults.download()[0];
    return complete;
}

}  // namespace veriray
