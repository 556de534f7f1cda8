// The image around the scene: its texels, and the choice among its cells (lights/image_sky.h).
#include <algorithm>

#include "core/math.h"
#include "scene/intervals.h"
#include "scene/scene.h"
#include "scene/sky_guide.h"
#include "scene/thread_pool.h"

namespace veriray {
// Returns the mean over the sphere of the sum of the channels; 0 for a black image, which has no
// tables. Images of less than three rows repeat their last one.
double HostScene::set_sky_map(const SceneInput& in, const SkyImage& image) {
    SkyMap& map = view.lights.map;
    const uint32_t width = image.width;
    map.width = width, map.height = image.cell_rows() + 1;
    const uint32_t cells = image.cell_rows();
    sky_texels.resize(size_t{kSkyFloats} * width * map.height + 1);  // gather3
    sky_ends.resize(size_t{cells} * (width + 1));
    sky_sines.resize(map.height);
    map.row_bits = guide_bits(cells), map.column_bits = guide_bits(width);
    const size_t row_guide = (size_t{1} << map.row_bits) + 1,
                 guide = (size_t{1} << map.column_bits) + 1;
    sky_guides.resize(row_guide + cells * guide);
    for (uint32_t j = 0; j < map.height; ++j) {
        float sine, cosine;
        sincos_2pi(static_cast<float>(j) / static_cast<float>(2 * cells), sine, cosine);
        sky_sines[j] = j == cells ? 0.f : sine;
    }
    const auto light = [&](uint32_t i, uint32_t j) { return image.light(i, j); };
    const auto channels = [&](uint32_t i, uint32_t j) {
        const float* t = image.texel(i, j);
        return t[0] + t[1] + t[2];
    };
    const double across = 2 * kPiDouble / width, down = kPiDouble / cells;
    std::vector<double> weight(cells), sum(map.height);
    const uint32_t threads = image.threads();
    // The mean over the sphere: Simpson's rule for the sine times the share of a row's texels.
    const auto mean = [&] {
        double strength = 0;
        for (uint32_t j = 0; j < cells; ++j) {
            float middle, cosine;
            sincos_2pi((static_cast<float>(j) + 0.5f) / static_cast<float>(2 * cells), middle,
                       cosine);
            for (uint32_t end = 0; end < 2; ++end)
                strength += sum[j + end] * (sky_sines[j + end] + 2 * middle);
        }
        return strength * down / 6 * across / (4 * kPiDouble);
    };
    const bool guided = openings_->places() > 0;
    map.less = 0;
    if (in.sky_compensated.data[0] && !guided) {
        std::vector<float> most(map.height);
        parallel(threads, map.height, {}, [&](uint32_t, uint64_t at) {
            const uint32_t j = static_cast<uint32_t>(at);
            for (uint32_t i = 0; i < width; ++i)
                sum[j] += light(i, j), most[j] = std::max(most[j], channels(i, j));
        });
        const float less = static_cast<float>(mean());
        // Of an even sky nothing would be left but rounding.
        if (*std::max_element(most.begin(), most.end()) > less * (1 + 0x1p-20f)) map.less = less;
        std::fill(sum.begin(), sum.end(), 0.);
    }
    // What ImageSky gives a texel's corner of a cell, in its arithmetic if something is left out.
    const auto wanted = [&](uint32_t i, uint32_t j) {
        return map.less > 0 ? double{std::max(channels(i, j) - map.less, 0.f)} : light(i, j);
    };
    const auto row = [&](uint32_t, uint64_t at) {
        const uint32_t j = static_cast<uint32_t>(at);
        float* out = sky_texels.data() + size_t{kSkyFloats} * width * j;
        std::copy_n(image.texel(0, j), size_t{kSkyFloats} * width, out);
        std::vector<double> here(width), sums(width);
        for (uint32_t i = 0; i < width; ++i) here[i] = light(i, j);
        for (uint32_t i = 0; i < width; ++i) sum[j] += here[i];
        if (j == cells) return;
        if (map.less > 0)
            for (uint32_t i = 0; i < width; ++i) here[i] = wanted(i, j);
        // As ImageSky's weights: a pole gives its light to its neighbour.
        const double upper = sky_sines[j], lower = sky_sines[j + 1];
        const double first = upper + (j == 0 ? lower : 0),
                     second = lower + (j + 1 == cells ? upper : 0);
        for (uint32_t i = 0; i < width; ++i) here[i] = here[i] * first + wanted(i, j + 1) * second;
        double before = 0;
        for (uint32_t i = 0; i < width; ++i)
            sums[i] = before += here[i] + here[i + 1 < width ? i + 1 : 0];
        weight[j] = before;
        put_intervals(sums, sky_ends.data() + cells + size_t{width} * j,
                      sky_guides.data() + row_guide + guide * j, map.column_bits);
    };
    parallel(threads, map.height, {}, row);
    std::vector<double> sums(cells);
    double before = 0;
    for (uint32_t j = 0; j < cells; ++j) sums[j] = before += weight[j];
    put_intervals(sums, sky_ends.data(), sky_guides.data(), map.row_bits);

    if (guided) {
        const SkyPatches patches(cells, width);
        std::vector<double> lines(size_t{cells} * patches.columns);  // by row of cells, by patch
        for (uint32_t j = 0; j < cells; ++j) {
            const float* ends = sky_ends.data() + cells + size_t{width} * j;
            float before = 0;
            for (uint32_t c = 0; c < patches.columns; ++c) {
                const float end = ends[patches.first_column(c + 1) - 1];
                lines[size_t{j} * patches.columns + c] = double{end - before} * weight[j];
                before = end;
            }
        }
        set_sky_guide(patches, *openings_, lines);
    }
    map.texels = sky_texels.data(), map.ends = sky_ends.data();
    map.sines = sky_sines.data(), map.guides = sky_guides.data();
    map.columns_per_radian = static_cast<float>(1 / across);
    map.rows_per_radian = static_cast<float>(1 / down);
    map.cell = static_cast<float>(across * down);
    map.shown = in.sky_muted.data[0] ? 0.f : 1.f;
    return mean();
}

}  // namespace veriray
