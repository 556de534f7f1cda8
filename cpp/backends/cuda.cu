// The CUDA back end: launches and errors; no radiance is computed here.
#include <cuda_runtime.h>

#include "backends/cuda_objects.cuh"
#include "backends/film_memory.h"
#include "backends/fused_kernel.cuh"
#include "backends/kernels.cuh"
#include "backends/launches.cuh"
#include "backends/render.h"

namespace veriray {
namespace {

constexpr uint64_t kLedgerRowsFetched = 4096;

template <class Tracer>
__global__ void __launch_bounds__(kFusedBlock, kFusedBlocks<Tracer::kMask>)
    fused_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                 const FusedItems items, Control* control, uint64_t* ledger) {
    trace_fused<Tracer>(scene, job, items, control, ledger);
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
    Scratch<Control> control(1, "control");
    // In the stream's order: a non-blocking stream does not wait for the default one.
    check(cudaMemsetAsync(control.get(), 0, sizeof(Control), l.work.s), "control");
    const auto launch = [&](const void* kernel) {
        const int per_sm = note_kernel(l.stats, kernel, kFusedBlock);
        const uint64_t resident = static_cast<uint64_t>(per_sm) * l.multiprocessors;
        uint64_t blocks = std::min<uint64_t>(resident, blocks_for(items.count, kFusedBlock));
        if (l.s.batch) blocks = std::clamp<uint64_t>(l.s.batch / kFusedBlock, 1, blocks);
        Control* shared = control.get();
        uint64_t* ledger = l.ledger.get();
        void* arguments[] = {const_cast<SceneView*>(&l.scene), const_cast<Job*>(&job), &items,
                             &shared, &ledger};
        check(cudaLaunchKernel(kernel, static_cast<unsigned>(blocks), kFusedBlock, arguments, 0,
                               l.work.s),
              "fused");
    };
    const FeatureMask features = l.scene.features;
    if (const void* made = l.s.all_features ? nullptr : fused_kernel_for(l.device, features)) {
        l.stats.features = features;
        launch(made);
    } else {
        with_variant(kIntegrator, choose_variant(l.scene, l.s), [&]<class Variant>() {
            using Tracer = typename Variant::template Tracer<Scalar>;
            launch(reinterpret_cast<const void*>(fused_kernel<Tracer>));
        });
    }
    ++l.stats.launches;
    Watch watch(l, &control.get()->cancel);
    watch.wait([&] { return cudaStreamQuery(l.work.s); },
               [&] {
                   return static_cast<double>(read_word(&control.get()->next, l.side)) /
                          static_cast<double>(items.count);
               });
    return watch.complete();
}

namespace {

__global__ void weigh_kernel(const FilterView filter, const SharedSamples samples, uint64_t rows) {
    const uint64_t row = blockIdx.x * static_cast<uint64_t>(blockDim.x) + threadIdx.x;
    if (row < rows) weigh_sample<Scalar>(filter, samples, row);
}

// Threads by pixel, blocks in y by units or runs of samples.
constexpr uint32_t kSharedRun = 16, kSharedBlock = 128;
__global__ void __launch_bounds__(kSharedBlock)
    shared_kernel(const FilterView filter, const __grid_constant__ Job job, uint32_t runs) {
    const uint64_t place = blockIdx.x * static_cast<uint64_t>(blockDim.x) + threadIdx.x;
    if (place >= job.pixels()) return;
    const uint32_t pixel = job.pixel(static_cast<uint32_t>(place));
    const uint32_t x = pixel % job.film.width, y = pixel / job.film.width;
    const bool alone = job.squares == Squares::kOfSamples;
    for (uint32_t r = blockIdx.y; r < runs; r += gridDim.y) {
        PixelSum sum{};
        const SampleRun run =
            job.squares == Squares::kOfUnits
                ? job.samples_of_unit(r)
                : SampleRun{r * kSharedRun, min((r + 1) * kSharedRun, job.samples)};
        for (uint32_t k = run.begin; k < run.end; ++k)
            add_sample(sum, shared_sample<Scalar>(filter, job.shared, x, y, k), alone);
        if (alone)
            flush(job.film, pixel, sum);
        else
            job.add_unit(pixel, sum, run.end - run.begin);
    }
}

__global__ void end_units_kernel(const __grid_constant__ Job job, uint32_t n) {
    const uint64_t place = blockIdx.x * static_cast<uint64_t>(blockDim.x) + threadIdx.x;
    if (place < job.pixels()) job.end_unit_of(job.pixel(static_cast<uint32_t>(place)), n);
}

class CudaRunner final : public Runner {
   public:
    CudaRunner(const Scene& scene, const RenderSettings& s, RenderStats& stats)
        : scene_(*scene.impl), view_(sampled_view(scene.impl->view)), s_(s), stats_(stats) {
        stats.device = "cuda:" + std::to_string(scene_.device);
        check(cudaDeviceGetAttribute(&multiprocessors_, cudaDevAttrMultiProcessorCount,
                                     scene_.device),
              "device");
        // Passes make more segments than max_depth counts.
        const bool bounded = s.max_depth >= 0 && !(view_.features & kGoOn);
        depths_ = (bounded ? std::max<int64_t>(1, s.max_depth) : kHardMaxDepth) + 1ull;
        faults_ = {1, "fault log"};
        ledger_ = empty_ledger();
    }
    // In half of the pool: each job ends when its longest path does.
    uint64_t shared_at_once(uint64_t numbers) const override {
        return DevicePool::of(scene_.device).most() / 2 / sizeof(float) / numbers;
    }
    float* share(uint64_t numbers) override {
        if (numbers > shared_.size()) shared_ = {numbers, "shared samples"};
        return shared_.get();
    }
    bool run(const Job& job, bool counted, const Poll& poll) override {
        RenderStats no_stats = stats_;
        if (!counted && !no_ledger_.get()) no_ledger_ = empty_ledger();
        const Launches launches{scene_.device,
                                view_,
                                s_,
                                counted ? stats_ : no_stats,
                                multiprocessors_,
                                work_,
                                side_,
                                counted ? ledger_ : no_ledger_,
                                3 * size_t{job.film.width} * job.film.height,
                                poll};
        const Scratch<uint32_t> listed = list(job);
        check(cudaMemsetAsync(faults_.get(), 0, sizeof(FaultLog), work_.s), "prepare");
        Job there = job;
        there.faults = faults_.get(), there.listed = listed.get();
        const bool complete = by_method(find_scheduler(s_.scheduler)->method, render_fused,
                                        render_thrust, render_wavefront)(launches, there);
        *job.faults = faults_.download()[0];
        return complete;
    }
    bool add_shared(const Job& job, const Poll&) override {
        const Scratch<uint32_t> listed = list(job);
        Job there = job;
        there.listed = listed.get();
        const uint64_t rows = job.shared.rows();
        if (job.shared.reach)
            weigh_kernel<<<blocks_for(rows, 256), 256, 0, work_.s>>>(view_.filter, job.shared,
                                                                     rows);
        const uint32_t runs = job.squares == Squares::kOfUnits
                                  ? job.units()
                                  : (job.samples + kSharedRun - 1) / kSharedRun;
        const dim3 blocks(blocks_for(job.pixels(), kSharedBlock), std::min(runs, 65535u));
        shared_kernel<<<blocks, kSharedBlock, 0, work_.s>>>(view_.filter, there, runs);
        check(cudaGetLastError(), "shared samples");
        check(cudaStreamSynchronize(work_.s), "shared samples");
        return true;
    }
    uint64_t* units(uint64_t pixels) override {
        if (!units_.get()) {
            units_ = {pixels * kUnitWords, "sums of samples"};
            units_.zero();
            wait_for_default("prepare");
        }
        return units_.get();
    }
    bool adds_units() const override { return false; }
    void end_units(const Job& job, uint32_t n) override {
        const Scratch<uint32_t> listed = list(job);
        Job there = job;
        there.listed = listed.get();
        end_units_kernel<<<blocks_for(job.pixels(), 256), 256, 0, work_.s>>>(there, n);
        check(cudaGetLastError(), "units");
        check(cudaStreamSynchronize(work_.s), "units");
    }
    // Rows beyond the last path's end stay on the device.
    std::vector<uint64_t> ledger(uint64_t first) override {
        const uint64_t n =
            std::min(first ? kLedgerRowsFetched : kLedgerRowsShared, depths_ - first);
        return ledger_.download(first * kLedgerColumns, n * kLedgerColumns);
    }

   private:
    Scratch<uint64_t> empty_ledger() const {
        Scratch<uint64_t> ledger{std::max<uint64_t>(depths_, kLedgerRowsShared) * kLedgerColumns,
                                 "ledger"};
        ledger.zero();
        wait_for_default("prepare");
        return ledger;
    }
    static Scratch<uint32_t> list(const Job& job) {
        return {job.listed, job.listed_count, "pixel list"};
    }

    const Scene::Impl& scene_;
    const SceneView view_;
    const RenderSettings& s_;
    RenderStats& stats_;
    int multiprocessors_;
    uint64_t depths_;
    Stream work_, side_;
    Scratch<uint64_t> ledger_, no_ledger_;
    Scratch<FaultLog> faults_;
    Scratch<float> shared_;
    Scratch<uint64_t> units_;
};

}  // namespace

std::unique_ptr<Runner> make_runner(const Scene& scene, const Film& film, const RenderSettings& s,
                                    RenderStats& stats) {
    if (film.impl->device != scene.impl->device)
        throw std::invalid_argument("film and scene are on different devices");
    use_device(scene.impl->device);
    return std::make_unique<CudaRunner>(scene, s, stats);
}

}  // namespace veriray
