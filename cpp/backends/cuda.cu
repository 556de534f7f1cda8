// The CUDA back end: launches and errors; no radiance is computed here.
#include <cuda_runtime.h>

#include "backends/cuda_objects.cuh"
#include "backends/items.cuh"
#include "backends/launches.cuh"
#include "schedulers/fused.h"
#include "schedulers/walking.h"

namespace veriray {
namespace {

constexpr uint32_t kFusedBlock = 128;
constexpr uint64_t kLedgerRowsFetched = 4096;

template <class Tracer>
__global__ void __launch_bounds__(kFusedBlock)
    fused_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                 const FusedItems items, Control* control, uint64_t* ledger) {
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
        add_together(sums + warp * 32, ended_samples + warp * 32, ended, sample);
    };
    const auto record = [&](uint32_t depth, uint32_t column) {
        counts.record(ledger, depth, column);
    };
    const auto run_flat = [&](auto take_one, auto add_one) {
        run_fused<typename Tracer::template With<Tracer::kMask & ~kBvh>>(scene, job, items, sum,
                                                                         take_one, add_one, record);
    };
    if ((Tracer::kMask & kBvh) && (scene.features & kBvh))
        run_walking<Tracer>(scene, job, items, sum, take, add, record);
    else if constexpr (kInStep<Tracer>)
        run_flat(take, add);
    else
        run_flat([&](bool asks) { return asks ? take_item(control, items.count) : items.count; },
                 [&](bool ended, const Spectrum<float>& sample) {
                     if (ended) add_sample(sum, sample);
                 });
    __syncthreads();
    counts.add_to(ledger);
}

}  // namespace

bool render_fused(const Launches& l, const Job& job) {
    FusedItems items;
    // Runs of 16 samples, shorter where that would leave the device without 8 items a thread.
    items.samples_per_item = static_cast<uint32_t>(
        std::clamp<uint64_t>(job.paths() / (8ull * 2048 * l.multiprocessors), 1, 16));
    if (l.s.batch) items.samples_per_item = std::clamp(l.s.batch / 65536u, 1u, 64u);
    const uint64_t runs = (job.samples + items.samples_per_item - 1) / items.samples_per_item;
    items.count = runs * job.pixels();
    Buffer<Control> control(1, "control");
    // In the stream's order: a non-blocking stream does not wait for the default one.
    check(cudaMemsetAsync(control.get(), 0, sizeof(Control), l.work.s), "control");
    with_variant(kIntegrator, choose_variant(l.scene, l.s), [&]<class Variant>() {
        using Tracer = typename Variant::template Tracer<Scalar>;
        const int per_sm = note_kernel(l.stats, fused_kernel<Tracer>, kFusedBlock);
        const uint64_t resident = static_cast<uint64_t>(per_sm) * l.multiprocessors;
        uint64_t blocks = std::min<uint64_t>(resident, blocks_for(items.count, kFusedBlock));
        if (l.s.batch) blocks = std::clamp<uint64_t>(l.s.batch / kFusedBlock, 1, blocks);
        fused_kernel<Tracer><<<static_cast<unsigned>(blocks), kFusedBlock, 0, l.work.s>>>(
            l.scene, job, items, control.get(), l.ledger.get());
        check_launch("fused");
    });
    ++l.stats.launches;
    Watch watch(l, &control.get()->cancel);
    watch.wait([&] { return cudaStreamQuery(l.work.s); },
               [&] {
                   return static_cast<double>(read_word(&control.get()->next, l.side)) /
                          static_cast<double>(items.count);
               });
    return watch.complete();
}

RenderStats render(const Scene& scene, Film& film, const RenderSettings& s, const Poll& poll) {
    const HostScene& host = scene.host();
    check_settings(s, host, film);
    if (film.impl->device != scene.impl->device)
        throw std::invalid_argument("film and scene are on different devices");
    use_device(scene.impl->device);
    match_scale(film.impl->view.scale, host.view.emission_scale);
    RenderStats stats;
    stats.threads = 0;
    cudaDeviceProp prop{};
    check(cudaGetDeviceProperties(&prop, scene.impl->device), "device");
    stats.device = std::string("cuda:") + std::to_string(scene.impl->device) + " " + prop.name;
    stats.features = kVariants[choose_variant(host.view, s)];
    // Passes make more segments than max_depth counts.
    const bool bounded = s.max_depth >= 0 && !(host.view.features & kPass);
    const uint64_t depths = (bounded ? std::max<int64_t>(1, s.max_depth) : kHardMaxDepth) + 1ull;
    Stream work, side;
    Buffer<uint64_t> ledger(std::max<uint64_t>(depths, kLedgerRowsShared) * kLedgerColumns,
                            "ledger");
    Buffer<FaultLog> faults(1, "fault log");
    Buffer<uint32_t> listed;
    if (!s.pixels.empty()) listed = {s.pixels, "pixel list"};
    ledger.zero();
    check(cudaDeviceSynchronize(), "prepare");
    const Clock::time_point start = Clock::now();
    bool complete = true;
    const uint64_t pixels = pixel_count(s, film);
    for_sample_ranges(s, pixels, poll,
                      [&](const PathSettings& settings, uint32_t begin, uint32_t samples,
                          uint32_t upper, const Poll& part) {
                          if (!complete) return;
                          const Launches launches{
                              scene.impl->view, s,   stats, prop.multiProcessorCount, work, side,
                              ledger,           part};
                          faults.zero();
                          check(cudaDeviceSynchronize(), "prepare");
                          const Job job{settings,
                                        film.impl->view,
                                        faults.get(),
                                        begin,
                                        samples,
                                        listed.get(),
                                        static_cast<uint32_t>(s.pixels.size())};
                          complete = by_method(find_scheduler(s.scheduler)->method, render_fused,
                                               render_thrust, render_wavefront)(launches, job);
                          add_faults(stats, faults.download()[0], film.width(), upper);
                      });
    if (!complete) throw std::runtime_error("the render was stopped; its film is incomplete");
    stats.seconds = seconds_since(start);
    const uint64_t samples = s.sample_end - s.sample_begin;
    if (s.pixels.empty()) film.impl->samples += samples;
    uint64_t live = samples * pixels;  // rows beyond the last path's end stay on the device
    for (uint64_t row = 0; row < depths && live; row += kLedgerRowsFetched) {
        const std::vector<uint64_t> rows = ledger.download(
            row * kLedgerColumns, std::min(kLedgerRowsFetched, depths - row) * kLedgerColumns);
        stats.ledger.insert(stats.ledger.end(), rows.begin(), rows.end());
        live = complete_ledger(stats.ledger, samples * pixels);
    }
    return stats;
}

}  // namespace veriray
