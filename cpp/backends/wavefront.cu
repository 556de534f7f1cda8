// Scheduler `wavefront` on CUDA. A stage is a grid as large as the device holds, which strides over
// a queue whose count it reads on the device; a CUDA graph launches kSteps steps at once. The host
// keeps one graph ahead and ends when a step has traced nothing.
#include "schedulers/wavefront.h"

#include "backends/launches.cuh"

namespace veriray {
namespace {

constexpr uint32_t kWaveBlock = 128;
constexpr uint32_t kSteps = 8;  // the last graphs' steps find nothing: four idle launches each

template <class Body>
__device__ void each_place(uint32_t n, Body body) {
    for (uint32_t k = blockIdx.x * kWaveBlock + threadIdx.x; k < n; k += gridDim.x * kWaveBlock)
        body(k);
}

__device__ bool is_first_thread() { return blockIdx.x == 0 && threadIdx.x == 0; }

template <uint32_t kFeatures>
__global__ void __launch_bounds__(kWaveBlock)
    refill_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                  const __grid_constant__ Wave w) {
    if (is_first_thread()) {  // the last step's queues
        for (uint32_t& n : w.counts->hits) n = 0;
        w.counts->shadows = 0;
    }
    if (atomic_load(&w.counts->stopped)) return;
    each_place(w.capacity, [&](uint32_t i) { wave_refill<kFeatures>(scene, job, w, i); });
}

template <uint32_t kFeatures>
__global__ void __launch_bounds__(kWaveBlock)
    trace_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Wave w) {
    const uint32_t n = w.counts->live;
    if (is_first_thread()) w.counts->traced = n;
    if (n == 0) return;
    fill_block_quads<kFeatures>(scene);
    each_place(n, [&](uint32_t k) { wave_trace<kFeatures>(scene, w, k); });
}

template <uint32_t kFeatures>
__global__ void __launch_bounds__(kWaveBlock)
    scatter_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                   const __grid_constant__ Wave w, uint64_t* ledger) {
    const uint32_t n = hit_places(w);
    if (is_first_thread()) w.counts->live = 0;  // traced
    if (n == 0) return;
    __shared__ BlockLedger counts;
    counts.clear();
    __syncthreads();
    each_place(n, [&](uint32_t k) {
        wave_scatter<kFeatures>(scene, job, w, k, [&](uint32_t depth, uint32_t column) {
            counts.record(ledger, depth, column);
        });
    });
    __syncthreads();
    counts.add_to(ledger);
}

template <uint32_t kFeatures>
__global__ void __launch_bounds__(kWaveBlock)
    shadow_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                  const __grid_constant__ Wave w, uint64_t* ledger) {
    const uint32_t n = w.counts->shadows;
    if (n == 0) return;
    __shared__ BlockLedger counts;
    counts.clear();
    fill_block_quads<kFeatures>(scene);
    __syncthreads();
    each_place(n, [&](uint32_t k) {
        wave_shadow<kFeatures>(scene, job, w, k, [&](uint32_t depth, uint32_t column) {
            counts.record(ledger, depth, column);
        });
    });
    __syncthreads();
    counts.add_to(ledger);
}

// Launches recorded once to be launched together.
class Graph {
   public:
    template <class Record>
    Graph(const Stream& stream, Record record) {
        cudaGraph_t graph = nullptr;
        std::exception_ptr error;
        check(cudaStreamBeginCapture(stream.s, cudaStreamCaptureModeThreadLocal), "graph");
        try {
            record();
        } catch (...) {
            error = std::current_exception();
        }
        cudaError_t status = cudaStreamEndCapture(stream.s, &graph);
        if (status == cudaSuccess && !error) status = cudaGraphInstantiate(&exec_, graph, 0);
        if (graph) cudaGraphDestroy(graph);
        if (error) {
            cudaGetLastError();
            std::rethrow_exception(error);
        }
        check(status, "graph");
    }
    ~Graph() { cudaGraphExecDestroy(exec_); }
    Graph(const Graph&) = delete;
    Graph& operator=(const Graph&) = delete;
    void launch(const Stream& stream) const { check(cudaGraphLaunch(exec_, stream.s), "graph"); }

   private:
    cudaGraphExec_t exec_ = nullptr;
};

struct Event {
    cudaEvent_t e = nullptr;
    Event() { check(cudaEventCreateWithFlags(&e, cudaEventDisableTiming), "event"); }
    ~Event() { cudaEventDestroy(e); }
    Event(const Event&) = delete;
    Event& operator=(const Event&) = delete;
};

template <uint32_t kFeatures>
Graph record_steps(const Launches& l, const Job& job, const Wave& w) {
    // Asking for the occupancy also loads the kernels, which a capture does not allow.
    const unsigned refill = resident_blocks(l, refill_kernel<kFeatures>, kWaveBlock, w.capacity),
                   trace = resident_blocks(l, trace_kernel<kFeatures>, kWaveBlock, w.capacity),
                   scatter = resident_blocks(l, scatter_kernel<kFeatures>, kWaveBlock,
                                             w.capacity + w.kinds * kKindPlaces),
                   shadow = resident_blocks(l, shadow_kernel<kFeatures>, kWaveBlock, w.capacity);
    const cudaStream_t s = l.work.s;
    uint64_t* const ledger = l.ledger.get();
    return Graph(l.work, [&] {
        for (uint32_t step = 0; step < kSteps; ++step) {
            refill_kernel<kFeatures><<<refill, kWaveBlock, 0, s>>>(l.scene, job, w);
            check_launch("refill");
            trace_kernel<kFeatures><<<trace, kWaveBlock, 0, s>>>(l.scene, w);
            check_launch("trace");
            scatter_kernel<kFeatures><<<scatter, kWaveBlock, 0, s>>>(l.scene, job, w, ledger);
            check_launch("scatter");
            shadow_kernel<kFeatures><<<shadow, kWaveBlock, 0, s>>>(l.scene, job, w, ledger);
            check_launch("shadow");
        }
    });
}

}  // namespace

bool render_wavefront(const Launches& l, const Job& job) {
    const uint32_t variant = choose_variant(l.scene, l.s), features = kVariants[variant];
    const uint32_t kinds = find_scheduler(l.s.scheduler)->sorted ? kHitKinds : 1;
    // By default 8,192 paths a multiprocessor: four for each thread that it can hold.
    const uint64_t wanted = l.s.batch ? l.s.batch : 8192ull * l.multiprocessors;
    const uint32_t capacity = static_cast<uint32_t>(std::min(wanted, job.paths()));
    Buffer<float> floats(static_cast<size_t>(wave_floats(features)) * capacity, "wave");
    Buffer<uint32_t> uints(static_cast<size_t>(wave_uints(features, kinds)) * capacity, "wave");
    Buffer<WaveCounts> counts(1, "wave");
    const Wave w = make_wave(features, kinds, capacity, floats.get(), uints.get(), counts.get());
    check(cudaMemsetAsync(w.state, 0xff, capacity * sizeof(uint32_t), l.work.s), "wave");
    check(cudaMemsetAsync(w.counts, 0, sizeof(WaveCounts), l.work.s), "wave");
    check(cudaStreamSynchronize(l.work.s), "wave");
    bool complete = false;
    with_variant(variant, [&]<uint32_t kFeatures>() {
        const Graph steps = record_steps<kFeatures>(l, job, w);
        const Event ends[2];
        Watch watch(l, &w.counts->stopped);
        const auto share = [&] {
            return static_cast<double>(read_word(&w.counts->begun, l.side)) /
                   static_cast<double>(job.paths());
        };
        for (uint64_t launch = 0; !watch.stopped(); ++launch) {
            steps.launch(l.work);
            check(cudaEventRecord(ends[launch % 2].e, l.work.s), "graph");
            ++l.stats.launches;
            if (launch == 0) continue;
            watch.wait([&] { return cudaEventQuery(ends[(launch - 1) % 2].e); }, share);
            // Once 0 it stays so: the graph under way may have written it anew.
            if (read_word(&w.counts->traced, l.side) == 0) break;
        }
        watch.wait([&] { return cudaStreamQuery(l.work.s); }, share);
        complete = watch.complete();
    });
    return complete;
}

}  // namespace veriray
