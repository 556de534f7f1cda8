// Films and scenes on the device.
#pragma once

#include <cstring>
#include <memory>
#include <vector>

#include "backends/device.cuh"
#include "scene/tree_layout.h"

namespace veriray {

struct DeviceTree {
    Buffer<WideNode<kDeviceWidth>> nodes;
    Buffer<float> records;  // by slot
    TreeInfo info;
};

// From the host's records, by either builder; launches in cuda_objects.cu.
DeviceTree build_tree_of(const HostScene& host, TreeBuilder builder, const BuildPoll& poll);

// The small tables of a scene, in one block and one copy: a camera that moves in a small scene
// makes a dozen of them. They are packed, sent, and handed out in the same order.
class Parcel {
   public:
    static bool takes(size_t bytes) { return bytes <= size_t{1} << 16; }
    bool sent() const { return block_ != nullptr; }
    void pack(const void* from, size_t bytes) {
        const size_t at = bytes_.size();
        bytes_.resize(at + rounded(bytes));
        std::memcpy(bytes_.data() + at, from, bytes);
    }
    void send() { block_ = std::make_shared<Scratch<char>>(bytes_.data(), bytes_.size(), "scene"); }
    template <class T>
    std::shared_ptr<const T> next(size_t bytes) {
        const char* at = block_->get() + handed_;
        handed_ += rounded(bytes);
        return {block_, reinterpret_cast<const T*>(at)};
    }

   private:
    std::vector<char> bytes_;
    std::shared_ptr<Scratch<char>> block_;
    size_t handed_ = 0;

    static size_t rounded(size_t bytes) { return (bytes + 255) / 256 * 256; }
};

// A table on the device, shared by all scenes that have it.
template <class T>
class DeviceTable {
   public:
    // The one of `host`, which is that of `was` if both hosts' tables are one; null: none. pointer:
    // to the host's rows if they are used. Called before and after the parcel is sent.
    void put(const Table<T>& host, const Table<T>* was, const T*& pointer, Parcel& parcel) {
        const size_t bytes = host.size() * sizeof(T);
        if (!was || !host.shares(*was)) {
            if (!parcel.sent()) {
                rows_ = nullptr;
                if (Parcel::takes(bytes)) return parcel.pack(host.data(), bytes);
                const auto own = std::make_shared<Buffer<T>>(host.rows(), "scene");
                rows_ = {own, own->get()};
            } else if (bytes && Parcel::takes(bytes)) {
                rows_ = parcel.next<T>(bytes);
            }
        }
        if (pointer) pointer = rows_.get();
    }

   private:
    std::shared_ptr<const T> rows_;
};

struct Scene::Impl {
    int device;
    HostScene host;
    DeviceTable<float> primitives, smooth, light_chance, light_row, surfaces, media, light_table,
        light_tree, filter_edges, uv, tangents, textures, sky_texels, sky_ends, sky_sines,
        sky_places, sky_rows, grids, cells, lobes, phase_values, phase_drawn, phase_ends,
        meter_patches;
    DeviceTable<uint32_t> surface_of, texels, sky_guides, phase_guides, meter_guides;
    TreeBuilder builder;
    std::shared_ptr<const DeviceTree> tree = std::make_shared<DeviceTree>();
    SceneView view;

    Impl(const SceneInput& in, int dev, TreeBuilder tree_builder, const BuildPoll& poll)
        : device(dev), host(in), builder(tree_builder) {
        use_device(dev);
        put_tables(nullptr);
        build_tree(poll);
    }
    // The same scene with a tree by another builder.
    Impl(const Impl& base, TreeBuilder tree_builder, const BuildPoll& poll) : Impl(base) {
        use_device(device);
        builder = tree_builder;
        build_tree(poll);
    }
    // The same primitives with other tables.
    Impl(const Impl& base, HostScene made) : Impl(base) {
        use_device(device);
        host = std::move(made);
        put_tables(&base.host);
        put_tree();
    }

   private:
    Impl(const Impl&) = default;

    void put_tables(const HostScene* was) {
        view = host.view;
        Parcel parcel;
        put_tables(was, parcel);
        parcel.send();
        put_tables(was, parcel);
    }
    void put_tables(const HostScene* was, Parcel& parcel) {
#define VR_PUT(name, pointer) name.put(host.name, was ? &was->name : nullptr, view.pointer, parcel)
        VR_PUT(primitives, primitives);
        VR_PUT(smooth, smooth);
        VR_PUT(uv, uv);
        VR_PUT(tangents, tangents);
        VR_PUT(textures, textures.table);
        VR_PUT(texels, textures.texels);
        VR_PUT(light_chance, light_chance);
        VR_PUT(light_row, light_row);
        VR_PUT(surfaces, surfaces);
        VR_PUT(media, media);
        VR_PUT(surface_of, surface_of);
        VR_PUT(light_table, lights.table);
        VR_PUT(light_tree, lights.tree.branches);
        VR_PUT(filter_edges, filter.edges);
        VR_PUT(meter_patches, camera.meter.patches);
        VR_PUT(meter_guides, camera.meter.guides);
        VR_PUT(grids, grids.table);
        VR_PUT(cells, grids.cells);
        VR_PUT(lobes, phases.lobes);
        VR_PUT(phase_values, phases.values);
        VR_PUT(phase_drawn, phases.drawn);
        VR_PUT(phase_ends, phases.ends);
        VR_PUT(phase_guides, phases.guides);
        VR_PUT(sky_texels, lights.map.texels);
        VR_PUT(sky_ends, lights.map.ends);
        VR_PUT(sky_sines, lights.map.sines);
        VR_PUT(sky_places, lights.map.guide.places);
        VR_PUT(sky_rows, lights.map.guide.rows);
        VR_PUT(sky_guides, lights.map.guides);
#undef VR_PUT
    }
    void build_tree(const BuildPoll& poll) {
        if (!(host.view.features & kBvh)) return;
        tree = std::make_shared<DeviceTree>(build_tree_of(host, builder, poll));
        put_tree();
    }
    void put_tree() {
        if (view.features & kBvh)
            view.bvh = {tree->nodes.get(), tree->records.get(), host.slab_slack};
    }
};

}  // namespace veriray
