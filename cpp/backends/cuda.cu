// The CUDA backend: memory, launches and errors; no radiance is computed here.
#include <cuda_runtime.h>

#include "backends/items.cuh"
#include "backends/launches.cuh"
#include "backends/leaks.h"
#include "backends/tree.cuh"
#include "schedulers/fused.h"
#include "schedulers/walking.h"

namespace veriray {
namespace {

// ---- kernels ----
constexpr uint32_t kFusedBlock = 128;
constexpr uint64_t kLedgerRowsFetched = 4096;

__global__ void resolve_kernel(FilmView film, uint64_t n, const uint64_t* counts, uint64_t values,
                               float* mean, float* error) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i >= values) return;
    resolve(film.words + i / 3 * kFilmWords, static_cast<uint32_t>(i % 3), film.scale,
            counts ? counts[i / 3] : n, mean[i], error[i]);
}

__global__ void add_kernel(uint64_t* a, const uint64_t* b, uint64_t numbers) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i >= numbers) return;
    Fixed128 x{a[2 * i], a[2 * i + 1]};
    add(x, {b[2 * i], b[2 * i + 1]});
    a[2 * i] = x.lo;
    a[2 * i + 1] = x.hi;
}

template <uint32_t kFeatures>
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
    fill_block_quads<kFeatures>(scene);
    __syncthreads();
    const auto take = [&](bool asks) { return take_items(stock, control, items.count, asks); };
    const auto add = [&](bool ended, const Spectrum<float>& sample) {
        add_together(sums + warp * 32, ended_samples + warp * 32, ended, sample);
    };
    const auto record = [&](uint32_t depth, uint32_t column) {
        counts.record(ledger, depth, column);
    };
    const auto run_flat = [&](auto take_one, auto add_one) {
        run_fused<kFeatures & ~kBvh>(scene, job, items, sum, take_one, add_one, record);
    };
    if ((kFeatures & kBvh) && (scene.features & kBvh))
        run_walking<kFeatures>(scene, job, items, sum, take, add, record);
    else if constexpr (kInStep<kFeatures>)
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

// ---- film ----
struct Film::Impl {
    int device;
    FilmView view{};
    uint64_t samples = 0;
    Buffer<uint64_t> words;
};

Film::Film(uint32_t width, uint32_t height, int device) : impl(std::make_unique<Impl>()) {
    check_film_size(width, height);
    use_device(device);
    impl->device = device;
    impl->words = Buffer<uint64_t>(static_cast<size_t>(width) * height * kFilmWords, "film");
    impl->words.zero();
    impl->view = {impl->words.get(), width, height, 0.f};
}
Film::~Film() = default;
uint32_t Film::width() const { return impl->view.width; }
uint32_t Film::height() const { return impl->view.height; }
uint64_t Film::samples() const { return impl->samples; }
size_t Film::memory() const { return impl->words.size() * sizeof(uint64_t); }
void Film::clear() {
    use_device(impl->device);
    impl->words.zero();
    impl->samples = 0;
    impl->view.scale = 0;
}

void Film::add(const Film& other) {
    if (other.width() != width() || other.height() != height() ||
        other.impl->device != impl->device)
        throw std::invalid_argument("films of different sizes or devices cannot be added");
    use_device(impl->device);
    match_scale(impl->view.scale, other.impl->view.scale);
    const uint64_t numbers = impl->words.size() / 2;
    add_kernel<<<blocks_for(numbers, 256), 256>>>(impl->words.get(), other.impl->words.get(),
                                                  numbers);
    check_launch("add films");
    check(cudaDeviceSynchronize(), "add films");
    impl->samples += other.impl->samples;
}

void Film::resolve(float* mean, float* standard_error, const uint64_t* counts) const {
    use_device(impl->device);
    const uint64_t values = impl->words.size() / 4;
    Buffer<float> out(2 * values, "resolved film");
    Buffer<uint64_t> by_pixel;
    if (counts) by_pixel = {std::vector<uint64_t>(counts, counts + values / 3), "resolved film"};
    FilmView view = impl->view;
    if (view.scale == 0) view.scale = 1.f;
    resolve_kernel<<<blocks_for(values, 256), 256>>>(view, impl->samples, by_pixel.get(), values,
                                                     out.get(), out.get() + values);
    check_launch("resolve film");
    check(cudaMemcpy(mean, out.get(), values * 4, cudaMemcpyDeviceToHost), "copy film");
    check(cudaMemcpy(standard_error, out.get() + values, values * 4, cudaMemcpyDeviceToHost),
          "copy film");
}

void Film::sums(double* out) const {
    use_device(impl->device);
    const std::vector<uint64_t> w = impl->words.download();
    const float scale = impl->view.scale ? impl->view.scale : 1.f;
    for (size_t i = 0; i < w.size() / 4; ++i)
        out[i] = film_sum(&w[i / 3 * kFilmWords], static_cast<uint32_t>(i % 3), scale);
}

void Film::words(uint64_t* out) const {
    use_device(impl->device);
    const std::vector<uint64_t> w = impl->words.download();
    std::copy(w.begin(), w.end(), out);
}

// ---- scene ----
struct Scene::Impl {
    int device;
    HostScene host;
    Buffer<float> primitives, smooth, light_chance, light_row, surfaces, media, light_table,
        filter_edges;
    Buffer<uint32_t> surface_of, light_cdf;
    TreeBuilder builder;
    DeviceTree tree;
    SceneView view;

    Impl(const SceneInput& in, int dev, TreeBuilder tree_builder, const BuildPoll& poll)
        : device(dev), host(in), builder(tree_builder), view(host.view) {
        use_device(dev);
        const auto upload = [](auto& buffer, const auto& v, auto& pointer) {
            buffer = std::remove_reference_t<decltype(buffer)>(v, "scene");
            if (pointer) pointer = buffer.get();
        };
        upload(primitives, host.primitives, view.primitives);
        upload(smooth, host.smooth, view.smooth);
        upload(light_chance, host.light_chance, view.light_chance);
        upload(light_row, host.light_row, view.light_row);
        upload(surfaces, host.surfaces, view.surfaces);
        upload(media, host.media, view.media);
        upload(surface_of, host.surface_of, view.surface_of);
        upload(light_table, host.light_table, view.lights.table);
        upload(light_cdf, host.light_cdf, view.lights.cdf);
        upload(filter_edges, host.filter_edges, view.filter.edges);
        if (!(host.view.features & kBvh)) return;
        tree = build_tree_of(host, builder, poll);
        view.bvh = {tree.nodes.get(), tree.records.get(), host.slab_slack};
    }
};

Scene::Scene(const SceneInput& in, int device, const std::string& builder, const BuildPoll& poll)
    : impl(std::make_unique<Impl>(in, device, find_builder(builder), poll)) {}
Scene::~Scene() = default;
const HostScene& Scene::host() const { return impl->host; }
TreeInfo Scene::tree() const { return impl->tree.info; }
TreeWords host_ploc(const Scene& scene, uint32_t width, uint32_t threads) {
    return host_ploc(scene.host(), kScalarWalk, width, threads);
}
TreeWords device_tree(const Scene& scene) {
    use_device(scene.impl->device);
    return scene.impl->tree.words();
}

// ---- render ----
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
    with_variant(choose_variant(l.scene, l.s), [&]<uint32_t kFeatures>() {
        const int per_sm = note_kernel(l.stats, fused_kernel<kFeatures>, kFusedBlock);
        const uint64_t resident = static_cast<uint64_t>(per_sm) * l.multiprocessors;
        uint64_t blocks = std::min<uint64_t>(resident, blocks_for(items.count, kFusedBlock));
        if (l.s.batch) blocks = std::clamp<uint64_t>(l.s.batch / kFusedBlock, 1, blocks);
        fused_kernel<kFeatures><<<static_cast<unsigned>(blocks), kFusedBlock, 0, l.work.s>>>(
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

// ---- hook of the test suite ----
namespace {
__global__ void intersect_kernel(const __grid_constant__ SceneView scene, const float* rays,
                                 uint64_t n, float* t, uint32_t* primitive) {
    fill_block_quads<kAllFeatures>(scene);
    __syncthreads();
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i >= n) return;
    const float* r = rays + 6 * i;
    const Hit<Scalar> hit = PathTracer<Scalar, kAllFeatures>::closest(
        scene, {{r[0], r[1], r[2]}, {r[3], r[4], r[5]}}, nothing_met<Scalar>(), kInfinity, true);
    t[i] = hit.t;
    primitive[i] = hit.primitive;
}

void put_hits(const HostScene& host, const std::vector<float>& distance,
              const std::vector<uint32_t>& primitive, float* t, int32_t* input) {
    for (size_t i = 0; i < distance.size(); ++i) {
        const bool met = distance[i] < kInfinity;
        t[i] = met ? static_cast<float>(distance[i] * host.unit) : kInfinity;
        input[i] = met ? static_cast<int32_t>(host.input_index[primitive[i]]) : -1;
    }
}
}  // namespace

void intersect(const Scene& scene, const double* origins, const double* directions, size_t n,
               float* t, int32_t* input) {
    use_device(scene.impl->device);
    const HostScene& host = scene.host();
    std::vector<float> rays(6 * n);
    for (size_t i = 0; i < n; ++i)
        normalise_ray(host, origins + 3 * i, directions + 3 * i, &rays[6 * i]);
    Buffer<float> in(rays, "rays"), distance(n, "hits");
    Buffer<uint32_t> primitive(n, "hits");
    if (n)
        intersect_kernel<<<blocks_for(n, 128), 128>>>(scene.impl->view, in.get(), n, distance.get(),
                                                      primitive.get());
    check_launch("intersect");
    put_hits(host, distance.download(), primitive.download(), t, input);
}

namespace {
__global__ void leak_kernel(const __grid_constant__ SceneView scene, const LeakTargets targets,
                            uint64_t first, uint64_t n, uint64_t* missed) {
    fill_block_quads<kAllFeatures>(scene);
    __syncthreads();
    const uint64_t stride = static_cast<uint64_t>(gridDim.x) * blockDim.x;
    for (uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x; i < n;
         i += stride) {
        bool at_edge;
        if (leaks(scene, targets, first + i, at_edge)) atomic_add(missed + at_edge, 1);
    }
}

template <uint32_t N>
__global__ void width_kernel(BvhView bvh, const float* rays, uint64_t n, float* t,
                             uint32_t* primitive) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i >= n) return;
    const float* r = rays + 6 * i;
    Hit<Scalar> hit{kInfinity, ~0u};
    closest_in_width<N, kTreeTriangles | kTreeSpheres | kTreeDisks>(
        bvh, {{r[0], r[1], r[2]}, {r[3], r[4], r[5]}}, nothing_met<Scalar>(), hit);
    t[i] = hit.t;
    primitive[i] = hit.primitive;
}

template <uint32_t N>
double time_width(const Scene::Impl& scene, const Buffer<float>& rays, uint64_t n, Buffer<float>& t,
                  Buffer<uint32_t>& primitive) {
    // Built anew: the slots are those of any width.
    const Buffer<WideNode<N>> nodes(
        build_tree<N>(scene.host.tree_input(), scene.builder, kScalarWalk, 0, {}).nodes, "tree");
    check(cudaDeviceSynchronize(), "prepare");
    const Clock::time_point start = Clock::now();
    width_kernel<N><<<blocks_for(n, 128), 128>>>(
        {nodes.get(), scene.tree.records.get(), scene.host.slab_slack}, rays.get(), n, t.get(),
        primitive.get());
    check_launch("intersect");
    check(cudaDeviceSynchronize(), "intersect");
    return seconds_since(start);
}
}  // namespace

std::pair<uint64_t, uint64_t> count_leaks(const Scene& scene, const double* origins,
                                          size_t origin_count, uint64_t first, uint64_t n) {
    use_device(scene.impl->device);
    const HostScene& host = scene.host();
    const Buffer<float> corners(leak_corners(host), "targets");
    const Buffer<float> from(leak_origins(host, origins, origin_count), "origins");
    Buffer<uint64_t> missed(2, "counts");
    missed.zero();
    const LeakTargets targets{corners.get(), static_cast<uint32_t>(corners.size() / 9), from.get(),
                              static_cast<uint32_t>(origin_count)};
    if (n) leak_kernel<<<4096, 128>>>(scene.impl->view, targets, first, n, missed.get());
    check_launch("leaks");
    const std::vector<uint64_t> counts = missed.download();
    return {counts[0], counts[1]};
}

double intersect_width(const Scene& scene, uint32_t width, const double* origins,
                       const double* directions, size_t n, float* t, int32_t* input) {
    use_device(scene.impl->device);
    const HostScene& host = scene.host();
    if (!(host.view.features & kBvh) || n == 0)
        throw std::invalid_argument("intersect_width needs a scene with a tree, and rays");
    std::vector<float> rays(6 * n);
    for (size_t i = 0; i < n; ++i)
        normalise_ray(host, origins + 3 * i, directions + 3 * i, &rays[6 * i]);
    Buffer<float> in(rays, "rays"), distance(n, "hits");
    Buffer<uint32_t> primitive(n, "hits");
    const double seconds = with_width(width, [&]<uint32_t N>() {
        return time_width<N>(*scene.impl, in, n, distance, primitive);
    });
    put_hits(host, distance.download(), primitive.download(), t, input);
    return seconds;
}

}  // namespace veriray
