// Scheduler `wavefront` on CUDA: a launch a stage, a block a tile. A CUDA graph launches kSteps
// steps at once; the host keeps one graph ahead and ends when all tiles are idle.
#include "schedulers/wavefront.h"

#include "backends/launches.cuh"

namespace veriray {
namespace {

constexpr uint32_t kWaveBlock = 128;
constexpr uint32_t kSteps = 8;  // those after the job's end are four idle launches each

// Calls body(k) for k < n; the threads of the block share.
template <class Body>
__device__ void each_of(uint32_t n, Body body) {
    for (uint32_t k = threadIdx.x; k < n; k += kWaveBlock) body(k);
}

template <class Tracer>
__global__ void __launch_bounds__(kWaveBlock)
    refill_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                  const __grid_constant__ Wave w) {
    if (w.queues[blockIdx.x].idle) return;
    __shared__ TileQueues q;
    __shared__ Refill r;
    const uint32_t first = blockIdx.x * kTileSlots;
    if (threadIdx.x == 0) q = {};
    __syncthreads();
    each_of(w.slots(first), [&](uint32_t k) { wave_sweep(w, q, first, first + k); });
    __syncthreads();
    if (threadIdx.x == 0) {
        r = wave_take(job, w, q);
        w.queues[blockIdx.x] = q;
    }
    __syncthreads();
    each_of(r.begins, [&](uint32_t k) { wave_begin<Tracer>(scene, job, w, r, first, k); });
}

template <class Tracer>
__global__ void __launch_bounds__(kWaveBlock)
    trace_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Wave w) {
    const uint32_t live = w.queues[blockIdx.x].live;
    if (live == 0) return;
    __shared__ TileQueues q;
    if (threadIdx.x == 0) q = w.queues[blockIdx.x];
    fill_block_quads<Tracer::kMask>(scene);
    __syncthreads();
    each_of(live, [&](uint32_t k) { wave_trace<Tracer>(scene, w, q, blockIdx.x * kTileSlots, k); });
    __syncthreads();
    if (threadIdx.x == 0) w.queues[blockIdx.x] = q;
}

// All hits; kind: those of one queue alone, and with `misses` those of queue 0.
constexpr uint32_t kEveryKind = ~0u;
template <class Tracer>
__global__ void __launch_bounds__(kWaveBlock)
    scatter_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                   const __grid_constant__ Wave w, uint32_t kind, bool misses, uint64_t* ledger) {
    if (w.queues[blockIdx.x].live == 0) return;
    __shared__ TileQueues q;
    __shared__ BlockLedger counts;
    if (threadIdx.x == 0) q = w.queues[blockIdx.x];
    counts.clear();
    __syncthreads();
    const auto scatter = [&](uint32_t of, uint32_t k) {
        wave_scatter<Tracer>(
            scene, job, w, q, blockIdx.x * kTileSlots, of, k,
            [&](uint32_t depth, uint32_t column) { counts.record(ledger, depth, column); });
    };
    const uint32_t missed = misses ? hit_places(q, 0) : 0;
    each_of(kind == kEveryKind ? hit_places(q) : missed + q.hits[kind], [&](uint32_t k) {
        uint32_t of = kind;
        if (kind == kEveryKind) {
            if (!find_hit(q, of, k)) return;
        } else if (k >= missed) {
            k -= missed;
        } else {
            of = 0;
            if (k >= q.hits[0]) return;
        }
        scatter(of, k);
    });
    __syncthreads();
    if (threadIdx.x == 0) w.queues[blockIdx.x] = q;
    counts.add_to(ledger);
}

template <class Tracer>
__global__ void __launch_bounds__(kWaveBlock)
    shadow_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                  const __grid_constant__ Wave w, uint64_t* ledger) {
    const uint32_t shadows = w.queues[blockIdx.x].shadows;
    if (shadows == 0) return;
    __shared__ BlockLedger counts;
    counts.clear();
    fill_block_quads<Tracer::kMask>(scene);
    __syncthreads();
    each_of(shadows, [&](uint32_t k) {
        wave_shadow<Tracer>(
            scene, job, w, blockIdx.x * kTileSlots, k,
            [&](uint32_t depth, uint32_t column) { counts.record(ledger, depth, column); });
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

// A capture does not allow that a kernel is loaded.
template <class... Kernels>
void load_kernels(Kernels... kernels) {
    cudaFuncAttributes attributes;
    (check(cudaFuncGetAttributes(&attributes, kernels), "kernels"), ...);
}

// Calls fn.template operator()<One>(queue) with the tracer of each kind of material that the scene
// has. In a tree hits are as they were sorted, but for blends; without one, rims may change them.
template <class Tracer, uint32_t kKind = 0, class Fn>
void each_kind(const SceneView& scene, Fn fn) {
    if constexpr (kKind < kMaterialCount) {
        constexpr FeatureMask kBit = materials(1u << kKind), kFlat = kQuads | kPolygons;
        if constexpr ((Tracer::kMask & kBit) != 0)
            if (scene.features & kBit)
                fn.template operator()<typename Tracer::template With<
                    (Tracer::kMask & ~(materials(kAllKinds) | kFlat)) | kBit>>(1 + kKind);
        each_kind<Tracer, kKind + 1>(scene, fn);
    }
}

// Calls fn(kernel, kind, misses) for the launches that scatter a wave's hits.
template <class Tracer, class Fn>
void each_scatter(const SceneView& scene, const Wave& w, Fn fn) {
    if constexpr ((Tracer::kMask & kBvh) != 0 && !Tracer::Material::kOneKind)
        if (w.kinds > 1 && (scene.features & kBvh) && !(scene.features & kBlend)) {
            bool misses = true;
            each_kind<Tracer>(scene, [&]<class One>(uint32_t queue) {
                fn(scatter_kernel<One>, queue, std::exchange(misses, false));
            });
            return;
        }
    fn(scatter_kernel<Tracer>, kEveryKind, false);
}

template <class Tracer>
Graph record_steps(const Launches& l, const Job& job, const Wave& w) {
    load_kernels(refill_kernel<Tracer>, trace_kernel<Tracer>, shadow_kernel<Tracer>);
    each_scatter<Tracer>(l.scene, w, [](auto kernel, uint32_t, bool) { load_kernels(kernel); });
    const uint32_t tiles = tile_count(w.capacity);
    const cudaStream_t s = l.work.s;
    uint64_t* const ledger = l.ledger.get();
    return Graph(l.work, [&] {
        for (uint32_t step = 0; step < kSteps; ++step) {
            refill_kernel<Tracer><<<tiles, kWaveBlock, 0, s>>>(l.scene, job, w);
            check_launch("refill");
            trace_kernel<Tracer><<<tiles, kWaveBlock, 0, s>>>(l.scene, w);
            check_launch("trace");
            each_scatter<Tracer>(l.scene, w, [&](auto kernel, uint32_t kind, bool misses) {
                kernel<<<tiles, kWaveBlock, 0, s>>>(l.scene, job, w, kind, misses, ledger);
                check_launch("scatter");
            });
            shadow_kernel<Tracer><<<tiles, kWaveBlock, 0, s>>>(l.scene, job, w, ledger);
            check_launch("shadow");
        }
    });
}

}  // namespace

bool render_wavefront(const Launches& l, const Job& job) {
    const uint32_t kinds = find_scheduler(l.s.scheduler)->sorted ? kHitKinds : 1;
    // By default 16 tiles a multiprocessor, whose blocks fill one that holds 2,048 threads.
    const uint64_t wanted = l.s.batch ? l.s.batch : 16ull * kTileSlots * l.multiprocessors;
    const uint32_t capacity = static_cast<uint32_t>(std::min(wanted, job.paths()));
    bool complete = false;
    with_variant(kIntegrator, choose_variant(l.scene, l.s), [&]<class Variant>() {
        using Tracer = typename Variant::template Tracer<Scalar>;
        const ColumnCount path = Tracer::columns(Tracer::kMask),
                          request = Tracer::request_columns(Tracer::kMask),
                          all = wave_columns(path, request, kinds);
        Scratch<float> floats(static_cast<size_t>(all.floats) * capacity, "wave");
        Scratch<uint32_t> uints(static_cast<size_t>(all.uints) * capacity, "wave");
        Scratch<TileQueues> queues(tile_count(capacity), "wave");
        Scratch<WaveControl> control(1, "wave");
        const Wave w = make_wave(path, request, kinds, capacity, floats.get(), uints.get(),
                                 queues.get(), control.get());
        check(cudaMemsetAsync(w.state, 0xff, capacity * sizeof(uint32_t), l.work.s), "wave");
        check(cudaMemsetAsync(w.queues, 0, queues.size() * sizeof(TileQueues), l.work.s), "wave");
        check(cudaMemsetAsync(w.control, 0, sizeof(WaveControl), l.work.s), "wave");
        check(cudaStreamSynchronize(l.work.s), "wave");
        note_kernel(l.stats, trace_kernel<Tracer>, kWaveBlock);
        const Graph steps = record_steps<Tracer>(l, job, w);
        const Event ends[2];
        Watch watch(l, &w.control->stopped);
        const auto share = [&] {
            return static_cast<double>(read_word(&w.control->begun, l.side)) /
                   static_cast<double>(job.paths());
        };
        for (uint64_t launch = 0; !watch.stopped(); ++launch) {
            steps.launch(l.work);
            check(cudaEventRecord(ends[launch % 2].e, l.work.s), "graph");
            ++l.stats.launches;
            if (launch == 0) continue;
            watch.wait([&] { return cudaEventQuery(ends[(launch - 1) % 2].e); }, share);
            if (read_word(&w.control->idle, l.side) == queues.size()) break;
        }
        watch.wait([&] { return cudaStreamQuery(l.work.s); }, share);
        complete = watch.complete();
    });
    return complete;
}

}  // namespace veriray
