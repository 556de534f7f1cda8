// Tables of media, and what follows from the walls around them.
#include <algorithm>

#include "scene/bounds.h"
#include "scene/box_pairs.h"
#include "scene/edge_hash.h"

namespace veriray {
namespace {

// The walls of a medium. edges: sum of hashes over the edges of triangles, oriented around the
// medium's outer side; 0 if the walls are closed, and by chance with a probability of 2^-64.
// volume: enclosed; negative if the medium is outside. other: the one medium beyond, 0 if there are
// several. outside: it is beyond walls, of others or of its own. clear: a wall lets light straight
// through.
struct Enclosure {
    uint64_t edges = 0;
    double volume = 0;
    uint32_t other = ~0u;
    bool disks = false, outside = false, clear = false;
    Box box{{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

    bool closed() const { return edges == 0 && volume > 0 && !disks; }
};

// Takes from the media those with a lamp in their boxes, or where one might be.
void drop_lit(const SceneInput& in, const std::vector<Enclosure>& all,
              std::vector<uint32_t>& media) {
    const auto drop = [&](const Box& lamp) {
        std::erase_if(media, [&](uint32_t m) { return meet(all[m].box, lamp); });
    };
    for (size_t q = 0; q < in.light_kind.count && !media.empty(); ++q) {
        const Double3 p = row3(in.light_position, q);
        if (in.light_has_place(q)) drop({p, p});
    }
    for (const ShapeGroup group : {kTriangleGroup, kSphereGroup, kDiskGroup}) {
        const auto& emission = in.emission(group);
        for (size_t i = 0; i < emission.count && !media.empty(); ++i)
            if (emission.data[i] >= 0) drop(box_around(in, group, i));
    }
}

}  // namespace

// Of each medium: which medium a ray in it is in that meets nothing, because it has left at an edge
// within rounding (the medium itself if that may be right: around the camera, or if its walls are
// open); whether light samples of points in it are in vain, because its walls are closed to all
// that is straight, no lamp is inside, and paths get in by its walls alone.
std::vector<MediumWalls> HostScene::media_walls(const SceneInput& in) const {
    std::vector<Enclosure> media(in.sigma_t.count + 1);
    // volume: behind the front, times 6
    const auto bound = [&](ShapeGroup group, size_t i, uint64_t edges, double volume) {
        const int32_t* border = in.boundaries.data + 2 * in.boundary(group).data[i];
        media[static_cast<size_t>(border[1] + 1)].outside = true;
        if (border[0] == border[1]) return;
        const Box box = veriray::box_around(in, group, i);
        const bool passes = passes_straight(in, in.material(group).data[i]);
        for (const int k : {0, 1}) {
            Enclosure& m = media[static_cast<size_t>(border[k] + 1)];
            const uint32_t other = static_cast<uint32_t>(border[1 - k] + 1);
            m.edges += k == 0 ? edges : 0 - edges;
            m.volume += k == 0 ? volume : -volume;
            m.other = m.other == ~0u || m.other == other ? other : 0;
            m.disks |= group == kDiskGroup;
            m.clear |= passes;
            m.box = around(m.box, box);
        }
    };
    for (size_t i = 0; i < in.triangles.count && in.boundaries.count > 0; ++i) {
        if (in.boundary(kTriangleGroup).data[i] < 0) continue;
        const Flat f = triangle(in, i);
        bound(kTriangleGroup, i, edges(f), dot(f.v[0], cross(f.v[1], f.v[2])));
    }
    for (size_t i = 0; i < in.spheres.count; ++i) {
        if (in.boundary(kSphereGroup).data[i] < 0) continue;
        const double r = in.spheres.data[4 * i + 3] / unit;
        const double volume = 8 * 3.14159265358979323846 * r * r * r;
        bound(kSphereGroup, i, 0, in.sphere_inward.data[i] ? -volume : volume);
    }
    for (size_t i = 0; i < in.disks.count; ++i)
        if (in.boundary(kDiskGroup).data[i] >= 0) bound(kDiskGroup, i, 0, 0);
    media[static_cast<size_t>(in.camera_medium + 1)].volume = 0;

    std::vector<MediumWalls> walls(media.size());
    std::vector<uint32_t> shut;
    for (uint32_t m = 1; m < walls.size(); ++m) {
        const uint32_t other = media[m].other;
        walls[m].beyond = !media[m].closed() ? m : media[other].closed() ? 0 : other;
        if (media[m].closed() && !media[m].outside && !media[m].clear) shut.push_back(m);
    }
    // Larger by more than the rounding of coordinates in the frame.
    for (const uint32_t m : shut) {
        Box& box = media[m].box;
        const Double3 low = box.low - centre, high = box.high - centre;
        const auto more = [&](int k) {
            return 0x1p-20 * std::max(std::abs(low[k]), std::abs(high[k]));
        };
        const Double3 rim{more(0), more(1), more(2)};
        box = {box.low - rim, box.high + rim};
    }
    drop_lit(in, media, shut);
    for (const uint32_t m : shut) walls[m].shut = true;
    return walls;
}

void HostScene::set_media(const SceneInput& in) {
    const size_t count = in.sigma_t.count + 1;  // 0: vacuum
    view.medium_stride = padded(count);
    media.assign(static_cast<size_t>(kMediumColumns) * view.medium_stride, 0.f);
    std::vector<bool> used(count, false);
    used[static_cast<size_t>(in.camera_medium + 1)] = true;
    if (in.boundaries.count > 0)
        for (const PrimitiveSource& p : sources)
            if (p.boundary >= 0)
                for (int k = 0; k < 2; ++k)
                    used[static_cast<size_t>(in.boundaries.data[2 * p.boundary + k] + 1)] = true;
    const std::vector<MediumWalls> walls = media_walls(in);
    view.shut_media = false;
    for (size_t m = 1; m < count; ++m) {
        const float* sigma = in.sigma_t.data + 3 * (m - 1);
        const auto put = [&](uint32_t c, double x) {
            media[static_cast<size_t>(c) * view.medium_stride + m] = static_cast<float>(x);
        };
        for (uint32_t k = 0; k < 3; ++k) {
            const double scaled = static_cast<double>(sigma[k]) * unit;
            if (!(scaled < 1e30))
                throw std::invalid_argument("sigma_t[" + std::to_string(m - 1) + "] = " +
                                            number(sigma[k]) + " is too dense for the scene");
            put(kMediumSigma + k, scaled);
            put(kMediumAlbedo + k, in.albedo.data[3 * (m - 1) + k]);
        }
        put(kMediumG, in.phase_g.data[m - 1]);
        put(kMediumBeyond, walls[m].beyond);
        put(kMediumShut, walls[m].shut ? 1 : 0);
        view.shut_media |= walls[m].shut;
        const int32_t albedo_grid = in.albedo_grid.data[m - 1];
        const int32_t sigma_grid = sigma[0] > 0 ? in.sigma_t_grid.data[m - 1] : -1;
        put(kMediumAlbedoGrid, albedo_grid);
        put(kMediumSigmaGrid, sigma_grid);
        if (!used[m]) continue;
        view.features |= kMedia;
        if (in.phase_lobe.data[m - 1] >= 0) view.features |= kPhases;
        if (albedo_grid >= 0) view.features |= kAlbedoGrids;
        if (sigma_grid >= 0) {
            view.features |= kUnevenMedia;
            if (!in.grid_grey.data[sigma_grid]) view.features |= kChromatic;
        }
        if (sigma[0] != sigma[1] || sigma[0] != sigma[2]) view.features |= kChromatic;
    }
    view.media = media.data();
    view.camera_medium = static_cast<uint32_t>(in.camera_medium + 1);
}

}  // namespace veriray
