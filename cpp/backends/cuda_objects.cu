// Films and scenes on the device.
#include "backends/cuda_objects.cuh"

#include "backends/instances.h"
#include "backends/tree.cuh"

namespace veriray {
namespace {

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

}  // namespace

DeviceTree build_tree_of(const HostScene& host, TreeBuilder builder, const BuildPoll& poll) {
    DeviceTree out;
    const Buffer<float> records(host.records, "tree"), boxes(host.round_boxes, "tree");
    Buffer<uint32_t> order;
    TreeInput in = host.tree_input();
    if (builder == TreeBuilder::kPloc) {
        in.records = records.get(), in.round_boxes = boxes.get();
        out = build_on_device(in, poll, order);
    } else {
        const auto tree = build_tree<kDeviceWidth>(in, builder, kScalarWalk, 0, poll);
        out.nodes = {tree.nodes, "tree"};
        order = {tree.order, "tree"};
        out.info = tree_info(builder, tree, 0);
    }
    out.records = {order.size() * kRecordFloats, "tree"};
    each_on_device(static_cast<uint32_t>(order.size() * 4),
                   GatherStep{reinterpret_cast<const float4*>(records.get()), order.get(),
                              reinterpret_cast<float4*>(out.records.get())});
    check(cudaDeviceSynchronize(), "tree");
    out.info.builder = kTreeBuilders[static_cast<uint32_t>(builder)];
    out.info.width = kDeviceWidth;
    out.info.nodes = out.nodes.size();
    out.info.references = order.size();
    out.info.memory =
        out.nodes.size() * sizeof(WideNode<kDeviceWidth>) + out.records.size() * sizeof(float);
    return out;
}

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

Scene::Scene(const SceneInput& in, int device, const std::string& builder, const BuildPoll& poll)
    : impl(std::make_unique<Impl>(in, device, find_builder(builder), poll)) {}
Scene::~Scene() = default;
const HostScene& Scene::host() const { return impl->host; }
TreeInfo Scene::tree() const { return impl->tree.info; }

}  // namespace veriray
