// Films and scenes on the device.
#include "backends/cuda_objects.cuh"

#include "backends/film_memory.h"
#include "backends/instances.h"
#include "backends/tree.cuh"

namespace veriray {

DeviceTree build_tree_of(const HostScene& host, TreeBuilder builder, const BuildPoll& poll) {
    DeviceTree out;
    const Scratch<float> records(host.records.rows(), "tree"),
        boxes(host.round_boxes.rows(), "tree");
    Scratch<uint32_t> order;
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
    wait_for_default("tree");
    out.info.builder = kTreeBuilders[static_cast<uint32_t>(builder)];
    out.info.width = kDeviceWidth;
    out.info.nodes = out.nodes.size();
    out.info.references = order.size();
    out.info.memory =
        out.nodes.size() * sizeof(WideNode<kDeviceWidth>) + out.records.size() * sizeof(float);
    return out;
}

namespace {

constexpr uint32_t kResolveBlock = 256;
constexpr unsigned kResolveBlocks = 2048;  // each adds its sum once

__global__ void __launch_bounds__(kResolveBlock)
    resolve_kernel(const __grid_constant__ ResolveChannels resolve_one, uint64_t n, ErrorSum* out) {
    ErrorSum sum{};
    const uint64_t step = static_cast<uint64_t>(gridDim.x) * kResolveBlock;
    for (uint64_t i = blockIdx.x * kResolveBlock + threadIdx.x; i < n; i += step)
        resolve_one(i, sum);
    for (uint32_t k = 16; k; k /= 2) {
        const Fixed128 other{__shfl_down_sync(~0u, sum.sum.lo, k),
                             __shfl_down_sync(~0u, sum.sum.hi, k)};
        add(sum.sum, other);
        sum.not_finite += __shfl_down_sync(~0u, sum.not_finite, k);
    }
    if (threadIdx.x % 32) return;
    const uint64_t before = atomic_add(&out->sum.lo, sum.sum.lo);
    atomic_add(&out->sum.hi, sum.sum.hi + (before + sum.sum.lo < before ? 1u : 0u));
    atomic_add(&out->not_finite, sum.not_finite);
}

class DevicePicture final : public PictureMemory {
   public:
    DevicePicture(size_t n, int device) : device_(device) {
        use_device(device);
        numbers_ = {n, "picture"};
    }
    ~DevicePicture() override {
        if (shared_) numbers_.free();  // others may still use it, on streams of theirs
    }
    float* numbers() override { return numbers_.get(); }
    void read(size_t first, size_t n, float* out) const override {
        use_device(device_);
        if (!Staging::fetch(device_, reinterpret_cast<char*>(out),
                            reinterpret_cast<const char*>(numbers_.get() + first),
                            n * sizeof(float)))
            numbers_.download(first, n, out);
    }
    void share() override { shared_ = true; }

   private:
    int device_;
    std::atomic<bool> shared_{false};
    Scratch<float> numbers_;
};

class DeviceFilm final : public FilmMemory {
   public:
    DeviceFilm(size_t words, int device) : device_(device) {
        use_device(device);
        words_ = {words, "film"};
        words_.zero();
    }
    ~DeviceFilm() override {
        if (in_child()) return;
        int before = 0;
        cudaGetDevice(&before);
        cudaSetDevice(device_);
        cudaStreamSynchronize(nullptr);  // which may still clear it
        cudaSetDevice(before);
    }
    uint64_t* words() override { return words_.get(); }
    void clear() override {
        use_device(device_);
        words_.zero();
    }
    void read(size_t first, size_t n, uint64_t* out) const override {
        use_device(device_);
        words_.download(first, n, out);
    }
    void add(const FilmMemory& other) override {
        use_device(device_);
        const auto& from = static_cast<const DeviceFilm&>(other);
        if (from.device_ == device_) return add_words(0, from.words_.get(), words_.size());
        const Scratch<uint64_t> part(std::min(kPeerWords, words_.size()), "film");
        for (size_t first = 0; first < words_.size(); first += part.size()) {
            const size_t n = std::min(part.size(), words_.size() - first);
            check(cudaMemcpyPeer(part.get(), device_, from.words_.get() + first, from.device_,
                                 n * sizeof(uint64_t)),
                  "copy film");
            add_words(first, part.get(), n);
        }
    }
    void add(size_t first, size_t n, const uint64_t* from) override {
        use_device(device_);
        add_words(first, Scratch<uint64_t>(from, n, "film").get(), n);
    }
    void end_unit(const FilmView& film, uint32_t n) override {
        use_device(device_);
        each_of(static_cast<uint64_t>(film.width) * film.height, EndUnit{film, n}, "units");
        wait_for_default("units");
    }
    std::unique_ptr<PictureMemory> resolve(const FilmView& film, uint32_t channels,
                                           const SampleCount& count, uint32_t,
                                           ErrorSum& sum) const override {
        const uint64_t pixels = static_cast<uint64_t>(film.width) * film.height,
                       size = pixels * channels;
        auto out = std::make_unique<DevicePicture>(2 * size + sizeof sum / sizeof(float), device_);
        float* numbers = out->numbers();
        const Scratch<uint64_t> by_pixel(count.by_pixel, count.by_pixel ? pixels : 0, "picture");
        SampleCount there_counted = count;
        there_counted.by_pixel = by_pixel.get();
        // of 8 bytes a channel, so it is aligned
        auto* there = reinterpret_cast<ErrorSum*>(numbers + 2 * size);
        check(cudaMemsetAsync(there, 0, sizeof sum), "resolve film");
        resolve_kernel<<<std::min(blocks_for(size, kResolveBlock), kResolveBlocks),
                         kResolveBlock>>>(
            ResolveChannels{film, channels, there_counted, numbers, numbers + size}, size, there);
        check_launch("resolve film");
        check(cudaMemcpy(&sum, there, sizeof sum, cudaMemcpyDeviceToHost), "resolve film");
        return out;
    }
    void put(const std::vector<PutFeature>& parts, uint64_t pixels, uint32_t) const override {
        use_device(device_);
        for (const PutFeature& part : parts) {
            each_of_kernel<<<blocks_for(pixels, 256), 256>>>(part, pixels);
            check_launch("feature images");
        }
        wait_for_default("feature images");
    }

   private:
    int device_;
    Scratch<uint64_t> words_;

    static constexpr size_t kPeerWords = 1 << 22;  // copied from another device at a time

    void add_words(size_t first, const uint64_t* from, size_t n) {
        each_of(n / 2, AddNumbers{words_.get() + first, from}, "add films");
    }
};

}  // namespace

std::unique_ptr<PictureMemory> picture_memory(size_t n, int device) {
    return std::make_unique<DevicePicture>(n, device);
}
std::unique_ptr<FilmMemory> film_memory(size_t words, int device) {
    return std::make_unique<DeviceFilm>(words, device);
}

Scene::Scene(const SceneInput& in, std::shared_ptr<const void> keeps, int device,
             const std::string& builder, const BuildPoll& poll)
    : impl(with_team(
          [&] { return std::make_unique<Impl>(in, device, find_builder(builder), poll); })),
      input(in),
      owner(std::move(keeps)) {}
Scene::Scene(std::unique_ptr<Impl> made, const SceneInput& in, std::shared_ptr<const void> keeps)
    : impl(std::move(made)), input(in), owner(std::move(keeps)) {}
Scene::~Scene() = default;
std::unique_ptr<Scene> Scene::changed(const SceneInput& in, std::shared_ptr<const void> keeps,
                                      bool rough) const {
    HostScene host = impl->host;
    if (!host.change(input, in, rough)) return nullptr;
    auto made = std::make_unique<Impl>(*impl, std::move(host));
    return std::unique_ptr<Scene>(new Scene(std::move(made), in, std::move(keeps)));
}
std::unique_ptr<Scene> Scene::rebuilt(const std::string& tree_builder,
                                      const BuildPoll& poll) const {
    auto made =
        with_team([&] { return std::make_unique<Impl>(*impl, find_builder(tree_builder), poll); });
    return std::unique_ptr<Scene>(new Scene(std::move(made), input, owner));
}
const void* Scene::family() const { return impl->tree.get(); }
const HostScene& Scene::host() const { return impl->host; }
TreeInfo Scene::tree() const { return impl->tree->info; }

}  // namespace veriray
