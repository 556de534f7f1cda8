// Scheduler `thrust` on CUDA: a launch a bounce, Thrust's algorithms between them.
#include "schedulers/thrust.h"

#include <thrust/execution_policy.h>
#include <thrust/system_error.h>

#include "backends/launches.cuh"

namespace veriray {
namespace {

template <class Tracer>
__global__ void __launch_bounds__(kThrustBlock)
    thrust_begin_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                        Columns paths, int32_t* indices, uint64_t first, uint32_t n) {
    const uint32_t i = blockIdx.x * kThrustBlock + threadIdx.x;
    if (i < n) thrust_begin<Tracer>(scene, job, paths, indices, first, i);
}

template <class Tracer>
__global__ void __launch_bounds__(kThrustBlock)
    thrust_bounce_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                         Columns paths, PathIndices indices, Compaction compaction, uint32_t depth,
                         uint32_t n, uint64_t* ledger_row) {
    __shared__ uint32_t counts[kLedgerColumns];
    if (threadIdx.x < kLedgerColumns) counts[threadIdx.x] = 0;
    fill_block_quads<Tracer::kMask>(scene);
    __syncthreads();
    const uint32_t k = blockIdx.x * kThrustBlock + threadIdx.x;
    if (k < n) {
        const BounceOutcome out =
            thrust_bounce<Tracer>(scene, job, paths, indices, compaction, depth, k);
        if (out.cause != kLive) atomicAdd(&counts[out.cause], 1u);
        if (out.shadow != kLive) atomicAdd(&counts[out.shadow], 1u);
    }
    __syncthreads();
    if (threadIdx.x < kLedgerColumns && counts[threadIdx.x])
        atomic_add(ledger_row + threadIdx.x, counts[threadIdx.x]);
}

// Executor of the `thrust` scheduler.
template <class Tracer>
struct DeviceExec {
    const Launches& l;
    const Job& job;
    const PathPool& pool;
    bool stopped = false;
    Clock::time_point last = Clock::now();

    void begin(const PathIndices& indices, uint64_t first, uint32_t n) {
        thrust_begin_kernel<Tracer><<<blocks_for(n, kThrustBlock), kThrustBlock, 0, l.work.s>>>(
            l.scene, job, pool.paths, indices.now, first, n);
        check_launch("begin");
        ++l.stats.launches;
    }
    void bounce(const PathIndices& indices, uint32_t depth, uint32_t n) {
        if (pool.compaction == Compaction::kAppend)
            check(cudaMemsetAsync(indices.appended, 0, sizeof(uint32_t), l.work.s), "bounce");
        thrust_bounce_kernel<Tracer><<<blocks_for(n, kThrustBlock), kThrustBlock, 0, l.work.s>>>(
            l.scene, job, pool.paths, indices, pool.compaction, depth, n,
            l.ledger.get() + static_cast<uint64_t>(depth) * kLedgerColumns);
        check_launch("bounce");
        ++l.stats.launches;
    }
    auto policy() const { return thrust::cuda::par.on(l.work.s); }
    uint32_t appended(const uint32_t* counter) const {
        uint32_t n = 0;
        check(cudaMemcpyAsync(&n, counter, sizeof n, cudaMemcpyDeviceToHost, l.work.s), "bounce");
        check(cudaStreamSynchronize(l.work.s), "bounce");
        return n;
    }
    double clock() const {
        check(cudaStreamSynchronize(l.work.s), "bounce");
        return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
    }
    bool poll(double share) {
        if (l.poll && Clock::now() - last > kPollPause) {
            stopped = !keeping_device([&] { return l.poll(share); });
            last = Clock::now();
        }
        return !stopped;
    }
};

}  // namespace

bool render_thrust(const Launches& l, const Job& job) {
    const Compaction compaction = find_scheduler(l.s.scheduler)->compaction;
    const size_t slots = pool_slots(l.s.batch, job);
    bool complete = false;
    const uint32_t variant = choose_variant(l.scene, l.s, kFewVariants);
    with_variant<kFewVariants>(kIntegrator, variant, [&]<class Variant>() {
        using Tracer = typename Variant::template Tracer<Scalar>;
        l.stats.features = Tracer::kMask;
        const ColumnCount columns = Tracer::columns(Tracer::kMask);
        Scratch<float> floats(columns.floats * slots, "path pool");
        Scratch<uint32_t> uints(columns.uints * slots, "path pool");
        Scratch<int32_t> index(index_columns(compaction) * slots, "path pool");
        Scratch<uint32_t> appended(1, "path pool");
        const PathPool pool = make_pool(compaction, static_cast<uint32_t>(slots), floats.get(),
                                        uints.get(), index.get(), appended.get());
        note_kernel(l.stats, thrust_bounce_kernel<Tracer>, kThrustBlock);
        DeviceExec<Tracer> exec{l, job, pool};
        try {
            run_thrust(exec, job.paths(), pool,
                       {l.stats.blocks, l.stats.depth_seconds, l.stats.compaction_seconds});
        } catch (const thrust::system_error& error) {
            cudaGetLastError();
            throw DeviceError(std::string("thrust: ") + error.what());
        } catch (const std::bad_alloc& error) {
            throw OutOfMemoryError(std::string("thrust: ") + error.what());
        }
        check(cudaStreamSynchronize(l.work.s), "thrust");
        complete = !exec.stopped;
    });
    return complete;
}

}  // namespace veriray
