// What is seen of the sky from where: for scenes that see it through openings
// (lights/guided_sky.h).
#pragma once

#include <bitset>
#include <thread>
#include <vector>

#include "scene/scene.h"

namespace veriray {

// Patches of the sky: blocks of 2^bits rows and columns of cells.
struct SkyPatches {
    static constexpr uint32_t kMostRows = 16, kMostColumns = 32;

    uint32_t cell_rows, cell_columns, row_bits, column_bits, rows, columns;

    SkyPatches(uint32_t cell_rows, uint32_t cell_columns);
    uint32_t count() const { return rows * columns; }
    uint32_t first_row(uint32_t row) const { return std::min(row << row_bits, cell_rows); }
    uint32_t first_column(uint32_t column) const {
        return std::min(column << column_bits, cell_columns);
    }
};

// Points in the places of a grid around the scene, and the patches that each sees past opaque
// surfaces. World coordinates, so that it does not depend on the camera.
struct SkyOpenings {
    using Seen = std::bitset<SkyPatches::kMostRows * SkyPatches::kMostColumns>;

    Double3 low{};     // corner of the grid
    double place = 0;  // edge of a place
    uint32_t along[3] = {};
    std::vector<uint32_t> first;  // by place: of its points, and their number behind the last
    std::vector<Seen> seen;       // by point
    double share = 1;             // of the sky's power, that points beside surfaces see

    size_t places() const { return size_t{along[0]} * along[1] * along[2]; }
};

// The image around a scene, or one for a sky of one colour.
struct SkyImage {
    const float* texels;  // null: there is no sky
    uint32_t width, rows;
    Double3 axes[3];  // the world's directions of its x, y and z

    explicit SkyImage(const SceneInput& in);
    SkyImage(const SkyImage&) = delete;
    SkyImage& operator=(const SkyImage&) = delete;

    bool even() const { return !even_.empty(); }
    uint32_t cell_rows() const { return std::max(rows, 3u) - 1; }
    // That are worth their start for loops over the image.
    uint32_t threads() const {
        return size_t{width} * (cell_rows() + 1) < 1 << 16
                   ? 1
                   : std::max(1u, std::thread::hardware_concurrency());
    }
    // Rows that the image lacks repeat its last one.
    const float* texel(uint32_t i, uint32_t j) const {
        return texels + 3 * (size_t{std::min(j, rows - 1)} * width + i);
    }
    // All channels.
    double light(uint32_t i, uint32_t j) const {
        const float* t = texel(i, j);
        return double{t[0]} + double{t[1]} + double{t[2]};
    }

   private:
    std::vector<float> even_;
};

// Without places where few of the points beside surfaces see little of the sky's power. bounds: of
// a large scene.
SkyOpenings sky_openings(const SceneInput& in, const SkyImage& sky, const SceneBounds* bounds);

// By patch, the weights of a place's light samples, and of places elsewhere (place ==
// places()). weight: of the patches' light.
std::vector<double> guided_weights(const SkyOpenings& openings, const SkyPatches& patches,
                                   size_t place, const std::vector<double>& weight);

}  // namespace veriray
