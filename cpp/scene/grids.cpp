// The table of grids.
#include <algorithm>

#include "scene/scene.h"

namespace veriray {
namespace {

// Mean free paths of the largest extinction across a grid's box; each is a step of a ray.
constexpr double kMostSteps = 65536;

}  // namespace

// What takes a normalised point (p, 1) to the unit cube that a matrix, 3 rows of 4, takes to the
// world.
std::array<double, 12> HostScene::to_cube(const double* m) const {
    const auto axis = [&](int k) { return Double3{m[k], m[4 + k], m[8 + k]} * (1 / unit); };
    const Double3 x = axis(0), y = axis(1), z = axis(2),
                  o = (Double3{m[3], m[7], m[11]} - centre) * (1 / unit);
    const Double3 across[] = {cross(y, z), cross(z, x), cross(x, y)};
    const double volume = dot(x, across[0]);
    std::array<double, 12> rows;
    for (size_t k = 0; k < 3; ++k) {
        const Double3 n = across[k] * (1 / volume);
        for (int c = 0; c < 3; ++c) rows[4 * k + static_cast<size_t>(c)] = n[c];
        rows[4 * k + 3] = -dot(n, o);
    }
    return rows;
}

void HostScene::set_grids(const SceneInput& in) {
    if (!(view.features & (kAlbedoGrids | kUnevenMedia))) return;
    const size_t count = in.grids_rows();
    const uint32_t stride = padded(count);
    grids.assign(size_t{kGridColumns} * stride, 0.f);
    for (size_t g = 0; g < count; ++g) {
        const auto put = [&](uint32_t c, double x) {
            grids[size_t{c} * stride + g] = static_cast<float>(x);
        };
        const double* m = in.grid_to_world.data + 12 * g;
        const auto axis = [&](int k) { return Double3{m[k], m[4 + k], m[8 + k]} * (1 / unit); };
        const Double3 x = axis(0), y = axis(1), z = axis(2),
                      o = (Double3{m[3], m[7], m[11]} - centre) * (1 / unit);
        const auto rows = to_cube(m);
        for (uint32_t k = 0; k < 12; ++k) put(kGridToLocal + k, rows[k]);
        for (uint32_t k = 0; k < 3; ++k) {
            const int c = static_cast<int>(k);
            const double below = std::min(x[c], 0.0) + std::min(y[c], 0.0) + std::min(z[c], 0.0);
            const double above = std::max(x[c], 0.0) + std::max(y[c], 0.0) + std::max(z[c], 0.0);
            put(kGridLow + k, o[c] + below);
            put(kGridHigh + k, o[c] + above);
            put(kGridSize + k, in.grid_size.data[3 * g + k]);
        }
        grids[size_t{kGridFirst} * stride + g] = bit_cast<float>(in.grid_first.data[g]);
        grids[size_t{kGridTraits} * stride + g] = bit_cast<float>(
            lookup_traits(in.grid_wrap.data[g], in.grid_filter.data[g], in.grid_grey.data[g] != 0));
        const double across_box = length(x) + length(y) + length(z);
        for (size_t k = 0; k < in.sigma_t_grid.count; ++k)
            if (in.sigma_t_grid.data[k] == static_cast<int32_t>(g)) {
                const double sigma = static_cast<double>(in.sigma_t.data[3 * k]);
                if (!(sigma * unit * across_box <= kMostSteps))
                    throw std::invalid_argument(
                        "sigma_t[" + std::to_string(k) + "] = " + number(sigma) +
                        " is too dense for its grid, whose edges together are " +
                        number(across_box * unit) + " long: " + number(kMostSteps) +
                        " mean free paths are allowed");
            }
    }
    cells.assign(in.cells.data, in.cells.data + in.cells.count);
    view.grids = {grids.data(), stride, static_cast<uint32_t>(count), cells.data()};
}

}  // namespace veriray
