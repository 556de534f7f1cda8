// Films and scenes on the device.
#pragma once

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

struct Scene::Impl {
    int device;
    HostScene host;
    Buffer<float> primitives, smooth, light_chance, light_row, surfaces, media, light_table,
        light_tree, filter_edges, uv, tangents, textures, sky_texels, sky_ends, sky_sines, grids,
        cells;
    Buffer<uint32_t> surface_of, texels, sky_guides;
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
        upload(uv, host.uv, view.uv);
        upload(tangents, host.tangents, view.tangents);
        upload(textures, host.textures, view.textures.table);
        upload(texels, host.texels, view.textures.texels);
        upload(light_chance, host.light_chance, view.light_chance);
        upload(light_row, host.light_row, view.light_row);
        upload(surfaces, host.surfaces, view.surfaces);
        upload(media, host.media, view.media);
        upload(surface_of, host.surface_of, view.surface_of);
        upload(light_table, host.light_table, view.lights.table);
        upload(light_tree, host.light_tree, view.lights.tree.branches);
        upload(filter_edges, host.filter_edges, view.filter.edges);
        upload(grids, host.grids, view.grids.table);
        upload(cells, host.cells, view.grids.cells);
        upload(sky_texels, host.sky_texels, view.lights.map.texels);
        upload(sky_ends, host.sky_ends, view.lights.map.ends);
        upload(sky_sines, host.sky_sines, view.lights.map.sines);
        upload(sky_guides, host.sky_guides, view.lights.map.guides);
        if (!(host.view.features & kBvh)) return;
        tree = build_tree_of(host, builder, poll);
        view.bvh = {tree.nodes.get(), tree.records.get(), host.slab_slack};
    }
};

}  // namespace veriray
