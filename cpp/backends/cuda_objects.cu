// Films and scenes on the device.
#include "backends/cuda_objects.cuh"

#include "backends/film_memory.h"
#include "backends/instances.h"
#include "backends/tree.cuh"

namespace veriray {

DeviceTree build_tree_of(const HostScene& host, TreeBuilder builder, const BuildPoll& poll) {
    DeviceTree out;
    const Buffer<float> records(host.records.rows(), "tree"),
        boxes(host.round_boxes.rows(), "tree");
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

namespace {

class DeviceFilm final : public FilmMemory {
   public:
    DeviceFilm(size_t words, int device) : device_(device) {
        use_device(device);
        words_ = {words, "film"};
        words_.zero();
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
        add_words(0, static_cast<const DeviceFilm&>(other).words_);
    }
    void add(size_t first, size_t n, const uint64_t* from) override {
        use_device(device_);
        add_words(first, {from, n, "film"});
    }
    void resolve(const FilmView& film, uint64_t n, const uint64_t* counts, float* mean,
                 float* error) const override {
        use_device(device_);
        const uint64_t pixels = static_cast<uint64_t>(film.width) * film.height;
        const Buffer<float> out(6 * pixels, "resolved film");
        const Buffer<uint64_t> by_pixel(counts, counts ? pixels : 0, "resolved film");
        each_of(3 * pixels,
                ResolveChannels{film, n, by_pixel.get(), out.get(), out.get() + 3 * pixels},
                "resolve film");
        out.download(0, 3 * pixels, mean);
        out.download(3 * pixels, 3 * pixels, error);
    }

   private:
    int device_;
    Buffer<uint64_t> words_;

    void add_words(size_t first, const Buffer<uint64_t>& from) {
        each_of(from.size() / 2, AddNumbers{words_.get() + first, from.get()}, "add films");
    }
};

}  // namespace

std::unique_ptr<FilmMemory> film_memory(size_t words, int device) {
    return std::make_unique<DeviceFilm>(words, device);
}

Scene::Scene(const SceneInput& in, std::shared_ptr<const void> keeps, int device,
             const std::string& builder, const BuildPoll& poll)
    : impl(std::make_unique<Impl>(in, device, find_builder(builder), poll)),
      input(in),
      owner(std::move(keeps)) {}
Scene::Scene(std::unique_ptr<Impl> made, const SceneInput& in, std::shared_ptr<const void> keeps)
    : impl(std::move(made)), input(in), owner(std::move(keeps)) {}
Scene::~Scene() = default;
std::unique_ptr<Scene> Scene::changed(const SceneInput& in,
                                      std::shared_ptr<const void> keeps) const {
    HostScene host = impl->host;
    if (!host.change(input, in)) return nullptr;
    auto made = std::make_unique<Impl>(*impl, std::move(host));
    return std::unique_ptr<Scene>(new Scene(std::move(made), in, std::move(keeps)));
}
const void* Scene::family() const { return impl->tree.get(); }
const HostScene& Scene::host() const { return impl->host; }
TreeInfo Scene::tree() const { return impl->tree->info; }

}  // namespace veriray
