// Scheduler `wavefront` on CUDA: a launch a stage, a block a tile. A CUDA graph launches kSteps
// steps at once; the host keeps one graph ahead and ends when all tiles are idle.
#include "backends/kernels.cuh"
#include "backends/launches.cuh"
#include "backends/wavefront_kernels.cuh"

namespace veriray {
namespace {

constexpr uint32_t kSteps = 8;  // those after the job's end are four idle launches each

template <class Tracer>
__global__ void __launch_bounds__(kWaveBlock)
    refill_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                  const __grid_constant__ Wave w) {
    block_refills<Tracer>(scene, job, w);
}
template <class Tracer>
__global__ void __launch_bounds__(kWaveBlock)
    trace_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Wave w) {
    block_traces<Tracer>(scene, w);
}
template <class Tracer, class Sorter = Tracer>
__global__ void __launch_bounds__(kWaveBlock)
    scatter_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                   const __grid_constant__ Wave w, uint32_t kind, bool misses, uint64_t* ledger) {
    block_scatters<Tracer, Sorter>(scene, job, w, kind, misses, ledger);
}
template <class Tracer>
__global__ void __launch_bounds__(kWaveBlock)
    shadow_kernel(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                  const __grid_constant__ Wave w, uint64_t* ledger) {
    block_shadows<Tracer>(scene, job, w, ledger);
}

// Launches that are started together, each after the one before. They are not captured from a
// stream, as a capture fails where any thread waits for the device meanwhile.
class Graph {
   public:
    Graph() { check(cudaGraphCreate(&graph_, 0), "graph"); }
    ~Graph() {
        if (exec_) cudaGraphExecDestroy(exec_);
        cudaGraphDestroy(graph_);
    }
    Graph(const Graph&) = delete;
    Graph& operator=(const Graph&) = delete;

    void add_clear(uint32_t* words, size_t n) {
        cudaMemsetParams what{};
        what.dst = words, what.elementSize = sizeof *words, what.width = n, what.height = 1;
        add([&](auto... place) { return cudaGraphAddMemsetNode(place..., &what); }, "clear");
    }
    template <class... Arguments>
    void add_kernel(const char* name, const void* kernel, uint32_t tiles, Arguments... arguments) {
        void* list[] = {const_cast<void*>(static_cast<const void*>(&arguments))...};
        cudaKernelNodeParams what{};
        what.func = const_cast<void*>(kernel), what.kernelParams = list;
        what.gridDim = dim3(tiles), what.blockDim = dim3(kWaveBlock);
        add([&](auto... place) { return cudaGraphAddKernelNode(place..., &what); }, name);
    }
    void finish() { check(cudaGraphInstantiate(&exec_, graph_, 0), "graph"); }
    void launch(const Stream& stream) const { check(cudaGraphLaunch(exec_, stream.s), "graph"); }

   private:
    cudaGraph_t graph_ = nullptr;
    cudaGraphExec_t exec_ = nullptr;
    cudaGraphNode_t last_ = nullptr;

    // add_node(node, graph, its predecessors, their number)
    template <class Add>
    void add(Add add_node, const char* name) {
        const cudaGraphNode_t before = last_;
        check(add_node(&last_, graph_, &before, size_t{before != nullptr}), name);
    }
};

struct Event {
    cudaEvent_t e = nullptr;
    Event() { check(cudaEventCreateWithFlags(&e, cudaEventDisableTiming), "event"); }
    ~Event() { cudaEventDestroy(e); }
    Event(const Event&) = delete;
    Event& operator=(const Event&) = delete;
};

template <class Tracer, uint32_t kKind = 0>
void put_scatters(FeatureMask features, WaveKernels& kernels) {
    if constexpr (kKind < kMaterialCount) {
        constexpr FeatureMask kBit = materials(1u << kKind);
        if constexpr ((Tracer::kMask & kBit) != 0)
            if (features & kBit)
                kernels.scatter[kKind] =
                    reinterpret_cast<const void*>(scatter_kernel<OneKind<Tracer, kKind>, Tracer>);
        put_scatters<Tracer, kKind + 1>(features, kernels);
    }
}

// The kernels of the compiled variant.
template <class Tracer>
WaveKernels compiled_kernels(FeatureMask features) {
    const auto code = [](auto* kernel) { return reinterpret_cast<const void*>(kernel); };
    WaveKernels kernels{Tracer::kMask,
                        code(refill_kernel<Tracer>),
                        code(trace_kernel<Tracer>),
                        code(shadow_kernel<Tracer>),
                        code(scatter_kernel<Tracer>),
                        {}};
    if constexpr ((Tracer::kMask & kBvh) != 0 && !Tracer::Material::kOneKind)
        put_scatters<Tracer>(features, kernels);
    return kernels;
}

// Calls fn(kernel, kind, misses) for the launches that scatter a wave's hits.
template <class Fn>
void each_scatter(const WaveKernels& kernels, const SceneView& scene, const Wave& w, Fn fn) {
    if (!by_kind(scene.features, w.kinds)) return fn(kernels.scatter_all, kEveryKind, false);
    bool misses = true;
    for (uint32_t kind = 0; kind < kMaterialCount; ++kind)
        if (scene.features & materials(1u << kind))
            fn(kernels.scatter[kind], 1 + kind, std::exchange(misses, false));
}

void add_steps(Graph& graph, const WaveKernels& kernels, const Launches& l, const Job& job,
               const Wave& w) {
    const uint32_t tiles = tile_count(w.capacity);
    uint64_t* const ledger = l.ledger.get();
    for (uint32_t step = 0; step < kSteps; ++step) {
        graph.add_clear(&w.control->parts, 3);
        graph.add_kernel("refill", kernels.refill, tiles, l.scene, job, w);
        graph.add_kernel("trace", kernels.trace, tiles, l.scene, w);
        each_scatter(kernels, l.scene, w, [&](const void* kernel, uint32_t kind, bool misses) {
            graph.add_kernel("scatter", kernel, tiles, l.scene, job, w, kind, misses, ledger);
        });
        graph.add_kernel("shadow", kernels.shadow, tiles, l.scene, job, w, ledger);
    }
    graph.finish();
}

// At each launch's end warps wait for the last rays, so a wave is as large as pays: 64 tiles a
// multiprocessor, if that is a quarter of the job's paths and half of the memory that is kept for
// the next render; 16 tiles, which fill a multiprocessor, at least.
uint32_t wave_slots(const Launches& l, const Job& job, size_t slot_bytes) {
    const uint64_t tile = static_cast<uint64_t>(kTileSlots) * l.multiprocessors;
    const uint64_t kept = DevicePool::of(l.device).most() / 2 / slot_bytes;
    const uint64_t pays = std::min({64 * tile, job.paths() / 4, kept});
    const uint64_t wanted = l.s.batch ? l.s.batch : std::max(16 * tile, pays);
    return static_cast<uint32_t>(std::min(wanted, job.paths()));
}

}  // namespace

bool render_wavefront(const Launches& l, const Job& job) {
    const uint32_t kinds = find_scheduler(l.s.scheduler)->sorted ? kHitKinds : 1;
    const FeatureMask features = l.scene.features;
    WaveKernels kernels;
    // Those of a scene have no scatter stage for hits that are left unsorted.
    const bool own = !l.s.all_features && by_kind(features, kinds) == by_kind(features, kHitKinds);
    if (const WaveKernels* made = own ? wave_kernels_for(l.device, features) : nullptr)
        kernels = *made;
    ColumnCount path, request;
    const uint32_t variant = choose_variant(l.scene, l.s, kFewVariants);
    with_variant<kFewVariants>(kIntegrator, variant, [&]<class Variant>() {
        using Tracer = typename Variant::template Tracer<Scalar>;
        if (!kernels.trace) kernels = compiled_kernels<Tracer>(features);
        path = Tracer::columns(kernels.features);
        request = Tracer::request_columns(kernels.features);
    });
    l.stats.features = kernels.features;
    const ColumnCount all = wave_columns(path, request, kinds);
    const uint32_t capacity = wave_slots(l, job, 4 * (all.floats + all.uints));
    Scratch<float> floats(static_cast<size_t>(all.floats) * capacity, "wave");
    Scratch<uint32_t> uints(static_cast<size_t>(all.uints) * capacity, "wave");
    Scratch<uint32_t> parts(static_cast<size_t>(tile_count(capacity)) * kTileParts, "wave");
    Scratch<TileQueues> queues(tile_count(capacity), "wave");
    Scratch<WaveControl> control(1, "wave");
    Wave w = make_wave(path, request, kinds, capacity, floats.get(), uints.get(), queues.get(),
                       control.get());
    w.parts = parts.get();
    check(cudaMemsetAsync(w.state, 0xff, capacity * sizeof(uint32_t), l.work.s), "wave");
    check(cudaMemsetAsync(w.queues, 0, queues.size() * sizeof(TileQueues), l.work.s), "wave");
    check(cudaMemsetAsync(w.control, 0, sizeof(WaveControl), l.work.s), "wave");
    check(cudaStreamSynchronize(l.work.s), "wave");
    note_kernel(l.stats, kernels.trace, kWaveBlock);
    Graph steps;
    add_steps(steps, kernels, l, job, w);
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
    return watch.complete();
}

}  // namespace veriray
