// Rejects values that a scene's arrays must not hold. Python checks more, with better messages;
// this keeps the native module safe on its own.
#include <algorithm>
#include <limits>
#include <type_traits>

#include "scene/scene.h"
#include "scene/thread_pool.h"

namespace veriray {

std::string number(double x) {
    char text[32];
    snprintf(text, sizeof text, "%g", x);
    return text;
}

namespace {

[[noreturn]] void fail(const std::string& name, size_t row, const std::string& rest) {
    throw std::invalid_argument(name + "[" + std::to_string(row) + "] " + rest);
}

constexpr size_t product(std::initializer_list<size_t> numbers) {
    size_t all = 1;
    for (const size_t n : numbers) all *= n;
    return all;
}

template <class T>
void within(const char* name, const Rows<T>& rows, size_t width, double low, double high,
            bool open) {
    const auto fits = [&](size_t i) {
        const double x = static_cast<double>(rows.data[i]);
        return (open ? (x > low) & (x < high) : (x >= low) & (x <= high)) &
               (std::abs(x) < INFINITY);
    };
    if (all_fit(rows.count * width, fits)) return;
    for (size_t i = 0; i < rows.count * width; ++i) {
        const double x = static_cast<double>(rows.data[i]);
        if (!(open ? x > low && x < high : x >= low && x <= high) || !std::isfinite(x))
            fail(name, i / width,
                 "holds " + number(x) + "; allowed: " + (open ? "(" : "[") + number(low) + ", " +
                     number(high) + (open ? ")" : "]"));
    }
}

template <class T>
void indexes(const char* name, const Rows<T>& rows, size_t width, int64_t least, size_t size) {
    // From `least` on: one comparison, of numbers as wide as the column's.
    using Width = std::make_unsigned_t<T>;
    const uint64_t known = size - static_cast<uint64_t>(least);
    const Width base = static_cast<Width>(least), last = static_cast<Width>(known - 1);
    if (known > 0 && known - 1 < std::numeric_limits<Width>::max() &&
        all_fit(rows.count * width, [&](size_t i) {
            return static_cast<Width>(static_cast<Width>(rows.data[i]) - base) <= last;
        }))
        return;
    for (size_t i = 0; i < rows.count * width; ++i) {
        const int64_t x = static_cast<int64_t>(rows.data[i]);
        if (x < least || x >= static_cast<int64_t>(size))
            fail(name, i / width,
                 "holds " + std::to_string(x) + "; there are " + std::to_string(size));
    }
}

template <class T>
void counts(const char* name, const Rows<T>& rows, size_t want) {
    if (rows.count != want)
        throw std::invalid_argument(std::string(name) + " has " + std::to_string(rows.count) +
                                    " rows, expected " + std::to_string(want));
}

// The checks of every column from the schema, but for those that `known` has passed them with.
void check_columns(const SceneInput& in, const SceneInput* known) {
#define VR_COLUMN(table, name, type, low, high, open, ...) \
    counts(#name, in.name, in.table##_rows());             \
    if (!known || !same_rows(in.name, known->name))        \
        within(#name, in.name, product({__VA_ARGS__}), low, high, open);
#define VR_INDEX(table, name, type, least, of, ...)                                         \
    counts(#name, in.name, in.table##_rows());                                              \
    if (!known || !same_rows(in.name, known->name) || in.of##_rows() != known->of##_rows()) \
        indexes(#name, in.name, product({__VA_ARGS__}), least, in.of##_rows());
#define VR_KIND(table, name, type, kinds, ...)      \
    counts(#name, in.name, in.table##_rows());      \
    if (!known || !same_rows(in.name, known->name)) \
        indexes(#name, in.name, product({__VA_ARGS__}), 0, kinds);
#include "schema/columns.def"
}

}  // namespace

void check_input(const SceneInput& in, const SceneInput* known) {
    constexpr double kLargest = 1e300;
    if (in.width == 0 || in.height == 0)
        throw std::invalid_argument("the film has no pixels: " + std::to_string(in.width) + " x " +
                                    std::to_string(in.height));
    check_columns(in, known);
    for (size_t i = 0; i < in.spheres.count; ++i)
        if (!(in.spheres.data[4 * i + 3] > 0)) fail("spheres", i, "has no radius above 0");
    for (size_t m = 0; m < in.materials_rows(); ++m)
        if (!(kMetalKinds >> in.material_kind.data[m] & 1u) && !(in.eta.data[3 * m] > 0))
            fail("eta", m, "holds 0; a transparent material needs more");
    for (size_t m = 0; m < in.materials_rows(); ++m) {  // or a blend might lead back to itself
        const int32_t other = in.blend_material.data[m];
        if (other >= 0 && static_cast<size_t>(other) <= m && in.blend_material.data[other] >= 0)
            fail("blend_material", m, "is a blend that does not come after it");
    }
    for (size_t i = 0; i < in.light_kind.count; ++i) {
        if (!kLights[shape_of_kind(in.light_kind.data[i])].cone) continue;
        const double cutoff = in.light_angles.data[2 * i], beam = in.light_angles.data[2 * i + 1];
        if (!(cutoff > 0 && cutoff <= 180 && beam >= 0 && beam <= cutoff))
            fail("light_angles", i,
                 "holds cutoff " + number(cutoff) + " and beam " + number(beam) +
                     "; allowed: 0 <= beam <= cutoff <= 180 degrees");
    }
    for (size_t i = 0; i < in.light_kind.count; ++i)
        if (kLights[shape_of_kind(in.light_kind.data[i])].framed)
            for (size_t k = 0; k < 2; ++k)
                if (!(length(row3(in.light_image, 2 * i + k)) > 0))
                    fail("light_image", i, "holds a row of zeros");
    std::vector<uint32_t> nested(in.textures_rows());
    for (size_t t = 0; t < in.textures_rows(); ++t) {
        const uint32_t kind = in.texture_kind.data[t];
        if (kind == kVertexAttribute || kind == kFaceAttribute) {
            const uint64_t rows = kind == kFaceAttribute ? in.triangles_rows() : in.vertices_rows();
            if (in.texture_first.data[t] + rows > in.attributes_rows())
                fail("texture_first", t,
                     "begins " + std::to_string(rows) + " rows of " +
                         std::to_string(in.attributes_rows()) + " attribute_values");
        }
        for (const int32_t field : {in.texture_field0.data[t], in.texture_field1.data[t]}) {
            if (field < 0) continue;
            if (kind != kCheckerboard || field >= static_cast<int64_t>(t))
                fail("texture_field", t,
                     "is " + std::to_string(field) +
                         "; allowed: of a checkerboard, a texture before it");
            nested[t] = std::max(nested[t], nested[static_cast<size_t>(field)] + 1);
            if (nested[t] > kMostNested)
                fail("texture_field", t,
                     "holds textures too deep; allowed: one in " + std::to_string(kMostNested) +
                         " others");
        }
        if (kind != kBitmap && kind != kVolume) continue;
        if (kind == kVolume && in.texture_format.data[t] != kFloat)
            fail("texture_format", t, "of a volume is not float");
        const uint64_t bytes = uint64_t{in.texture_width.data[t]} * in.texture_height.data[t] *
                               (kind == kVolume ? in.texture_depth.data[t] : 1u) *
                               texel_bytes(in.texture_format.data[t], in.texture_grey.data[t] != 0);
        const uint64_t last = in.texture_first.data[t] + (bytes + 3) / 4;
        if (bytes >= uint64_t{1} << 32 || last > in.texels.count || last >= kMostNumbers)
            fail("texture_first", t,
                 "begins texels that end at " + std::to_string(last) + "; there are " +
                     std::to_string(in.texels.count) + ", and at most 2^31 - 512 are allowed");
    }
    for (size_t g = 0; g < in.grids_rows(); ++g) {
        const uint32_t* size = in.grid_size.data + 3 * g;
        const uint64_t last = in.grid_first.data[g] + uint64_t{size[0]} * size[1] * size[2] *
                                                          (in.grid_grey.data[g] ? 1 : 3);
        if (last > in.cells.count || last > kMostNumbers)
            fail("grid_first", g,
                 "begins cells that end at " + std::to_string(last) + "; there are " +
                     std::to_string(in.cells.count) + ", and at most 2^31 - 512 are allowed");
    }
    for (size_t k = 0; k < in.lobes_rows(); ++k) {
        if (in.lobe_kind.data[k] == kFlakes) {
            const double* s = in.lobe_flakes.data + 6 * k;
            const double two = s[0] * s[1] - s[3] * s[3];
            const double three =
                s[2] * two - s[0] * s[5] * s[5] - s[1] * s[4] * s[4] + 2 * s[3] * s[4] * s[5];
            if (!(s[0] > 0 && two > 0 && three > 0))
                fail("lobe_flakes", k, "is no matrix of a positive area in every direction");
        }
        if (in.lobe_kind.data[k] != kTabulated) continue;
        const uint64_t first = in.lobe_values.data[k], last = first + in.lobe_size.data[k];
        if (last > in.phase_values.count)
            fail("lobe_values", k,
                 "begins values that end at " + std::to_string(last) + " of " +
                     std::to_string(in.phase_values.count) + " phase_values");
        if (std::none_of(in.phase_values.data + first, in.phase_values.data + last,
                         [](float x) { return x > 0; }))
            fail("lobe_values", k, "begins values that are all 0");
    }
    for (size_t m = 0; m < in.sigma_t.count; ++m) {
        const int64_t first = in.phase_lobe.data[m], last = first + in.phase_lobes.data[m];
        if (first < 0) continue;
        if (last > static_cast<int64_t>(in.lobes_rows()))
            fail("phase_lobe", m,
                 "begins lobes that end at " + std::to_string(last) + " of " +
                     std::to_string(in.lobes_rows()));
        if (std::none_of(in.lobe_share.data + first, in.lobe_share.data + last,
                         [](float x) { return x > 0; }))
            fail("phase_lobe", m, "begins lobes that have no share");
    }
    const uint64_t sky = uint64_t{in.sky_size.data[0]} * in.sky_size.data[1];
    if (sky != in.sky_texels.count || sky > kMostSkyTexels)
        throw std::invalid_argument("sky_size holds " + std::to_string(in.sky_size.data[0]) +
                                    " x " + std::to_string(in.sky_size.data[1]) + " texels of " +
                                    std::to_string(in.sky_texels.count));
    if (in.camera_medium < -1 || in.camera_medium >= static_cast<int64_t>(in.sigma_t.count))
        throw std::invalid_argument("the camera's medium " + std::to_string(in.camera_medium) +
                                    " does not exist");
    if (!(in.aperture_radius >= 0 && in.aperture_radius < kLargest) ||
        (in.aperture_radius > 0 && !(in.focus_distance > 0 && in.focus_distance < kLargest)))
        throw std::invalid_argument("aperture_radius = " + number(in.aperture_radius) +
                                    ", focus_distance = " + number(in.focus_distance) +
                                    "; allowed: finite, >= 0 and > 0");
}

}  // namespace veriray
