// Hooks of the test suite, on the device.
#include <chrono>

#include "backends/cuda_objects.cuh"
#include "backends/hooks.h"
#include "backends/launches.cuh"
#include "backends/leaks.h"
#include "backends/testing.h"

namespace veriray {

TreeWords host_ploc(const Scene& scene, uint32_t width, uint32_t threads) {
    return host_ploc(scene.host(), kScalarWalk, width, threads);
}
TreeWords device_tree(const Scene& scene) {
    use_device(scene.impl->device);
    WideTree<kDeviceWidth> tree{scene.impl->tree->nodes.download(), {}};
    const std::vector<float> r = scene.impl->tree->records.download();
    for (size_t at = 0; at < r.size(); at += kRecordFloats)
        tree.order.push_back(bit_cast<uint32_t>(r[at + kRecordId]));
    return tree_words(tree);
}

namespace {
__global__ void function_kernel(uint32_t which, uint32_t inputs, uint32_t outputs, const float* x,
                                float* y, uint64_t n) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < n) evaluate<Scalar>(which, x + i * inputs, y + i * outputs);
}

__global__ void random_kernel(uint64_t seed, Sampler sampler, const uint32_t* pixel,
                              const uint64_t* sample, const uint32_t* block, uint32_t* out,
                              uint64_t n) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i >= n) return;
    const RandomKey key = random_key(seed, static_cast<uint32_t>(sample[i] >> 32), sampler);
    const Block<uint32_t> r =
        random_block(key, pixel[i], static_cast<uint32_t>(sample[i]), block[i]);
    out[4 * i] = r.x, out[4 * i + 1] = r.y, out[4 * i + 2] = r.z, out[4 * i + 3] = r.w;
}
}  // namespace

std::pair<size_t, size_t> function_shape(const std::string& name) {
    const FunctionInfo& f = kFunctions[find_function(name)];
    return {f.inputs, f.outputs};
}

std::vector<float> eval_function(const std::string& name, const std::vector<float>& x) {
    const uint32_t which = find_function(name);
    const FunctionInfo& f = kFunctions[which];
    use_device(0);
    const uint64_t n = x.size() / f.inputs;
    Buffer<float> in(x, "arguments"), out(n * f.outputs, "values");
    if (n)
        function_kernel<<<blocks_for(n, 256), 256>>>(which, f.inputs, f.outputs, in.get(),
                                                     out.get(), n);
    check_launch("function");
    return out.download();
}

std::vector<uint32_t> random_words(uint64_t seed, Sampler sampler,
                                   const std::vector<uint32_t>& pixel,
                                   const std::vector<uint64_t>& sample,
                                   const std::vector<uint32_t>& block) {
    use_device(0);
    Buffer<uint32_t> p(pixel, "arguments"), b(block, "arguments"), out(4 * pixel.size(), "values");
    Buffer<uint64_t> s(sample, "arguments");
    if (!pixel.empty())
        random_kernel<<<blocks_for(pixel.size(), 256), 256>>>(seed, sampler, p.get(), s.get(),
                                                              b.get(), out.get(), pixel.size());
    check_launch("random");
    return out.download();
}

FaultLog add_values(Film& film, const std::string& plane, float scale,
                    const std::vector<uint32_t>& pixel, const std::vector<float>& x) {
    use_device(film.impl->device);
    const PlaneView view = checked_plane(film, plane, scale, pixel, x);
    const Buffer<uint32_t> pixels(pixel, "arguments");
    const Buffer<float> values(x, "arguments");
    Buffer<FaultLog> faults(1, "fault log");
    faults.zero();
    each_of(pixel.size(), AddValues{view, faults.get(), pixels.get(), values.get()}, "add values");
    return faults.download()[0];
}

void add_integers(Film& film, const std::string& plane, const std::vector<uint32_t>& pixel,
                  const std::vector<uint64_t>& x) {
    use_device(film.impl->device);
    const PlaneView view = checked_plane(film, plane, 0, pixel, x);
    const Buffer<uint32_t> pixels(pixel, "arguments");
    const Buffer<uint64_t> values(x, "arguments");
    each_of(pixel.size(), AddIntegers{view, pixels.get(), values.get()}, "add integers");
}

namespace {
__global__ void intersect_kernel(const __grid_constant__ SceneView scene, const float* rays,
                                 uint64_t n, float* t, uint32_t* primitive) {
    fill_block_quads<kAllFeatures>(scene);
    __syncthreads();
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i >= n) return;
    const float* r = rays + 6 * i;
    const Hit<Scalar> hit = SurfaceReader<Scalar, kAllFeatures>::closest(
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
struct LightQueryView {
    const float* places;
    const uint32_t *sides, *u24, *row;
    uint32_t* chosen;
    float *chance, *of_row;
};
__global__ void light_kernel(const __grid_constant__ SceneView scene, LightQueryView q,
                             uint64_t n) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i >= n) return;
    answer_light<Scalar>(scene.lights, q.places + 6 * i, q.sides[i], q.u24[i], q.row[i],
                         q.chosen[i], q.chance[i], q.of_row[i], true);
}
}  // namespace

std::pair<std::vector<float>, uint32_t> light_tree(const Scene& scene) {
    const Table<float>& branches = scene.host().light_tree;
    return {{branches.begin(), branches.end()}, scene.host().view.lights.tree.root};
}

LightAnswer choose_lights(const Scene& scene, const double* points, const double* normals,
                          LightQuery query) {
    use_device(scene.impl->device);
    query = light_query(scene.host(), points, normals, std::move(query));
    const size_t n = query.row.size();
    Buffer<float> places(query.places, "places"), chance(n, "chances"), of_row(n, "chances");
    Buffer<uint32_t> sides(query.sides, "sides"), u24(query.u24, "numbers"), row(query.row, "rows"),
        chosen(n, "rows");
    if (n)
        light_kernel<<<blocks_for(n, 128), 128>>>(scene.impl->view,
                                                  {places.get(), sides.get(), u24.get(), row.get(),
                                                   chosen.get(), chance.get(), of_row.get()},
                                                  n);
    check_launch("choose_lights");
    return {chosen.download(), chance.download(), of_row.download()};
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
    closest_in_width<N, kTreeAll>(bvh, {{r[0], r[1], r[2]}, {r[3], r[4], r[5]}},
                                  nothing_met<Scalar>(), hit);
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
        {nodes.get(), scene.tree->records.get(), scene.host.slab_slack}, rays.get(), n, t.get(),
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
