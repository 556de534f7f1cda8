// The table of a camera whose rays begin at, or go to, a shape.
#include <algorithm>

#include "scene/intervals.h"
#include "scene/scene.h"

namespace veriray {
namespace {

// Rays begin that far before a sphere, times its largest coordinate: 16 roundings of that.
constexpr double kBefore = 0x1p-20;

double largest(Double3 p) { return std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)}); }

}  // namespace

void HostScene::set_meter(const SceneInput& in) {
    MeterView& m = view.camera.meter;
    const Rows<double>& rows = in.meter_patches;
    if (!rows.count) return;
    const uint32_t count = m.count = static_cast<uint32_t>(rows.count);
    const auto vector = [&](uint32_t k, uint32_t column) {
        const double* row = rows.data + size_t{k} * kPatchColumns + column;
        return Double3{row[0], row[1], row[2]};
    };
    const auto kind_of = [&](uint32_t k) {
        return static_cast<PatchKind>(rows.data[size_t{k} * kPatchColumns]);
    };
    std::vector<double> areas(count), sums;
    double total = 0;
    for (uint32_t k = 0; k < count; ++k) {
        const Double3 a = vector(k, 5), b = vector(k, 8);
        const PatchKind kind = kind_of(k);
        areas[k] = kind == PatchKind::kSphere          ? 4 * kPiDouble * a.x * a.x
                   : kind == PatchKind::kDisk          ? kPiDouble * length(cross(a, b))
                   : kind == PatchKind::kParallelogram ? length(cross(a, b))
                                                       : length(cross(a, b)) / 2;
        sums.push_back(total += areas[k]);
    }
    if (!(total > 0 && std::isfinite(total)))
        throw std::invalid_argument("the camera's patches have an area of " + number(total));
    m.kind = in.meter_distant ? MeterKind::kDistant : MeterKind::kIrradiance;
    m.bits = guide_bits(count);
    m.across = static_cast<float>(1.0 / in.width), m.down = static_cast<float>(1.0 / in.height);
    meter_patches.assign(size_t{count} * (1 + kPatchFloats), 0.f);
    meter_guides.assign((size_t{1} << m.bits) + 1, 0u);
    put_intervals(sums, meter_patches.data(), meter_guides.data(), m.bits);
    for (uint32_t k = 0; k < count; ++k) {
        const double end = meter_patches[k], begin = k ? meter_patches[k - 1] : 0;
        const double side = rows.data[size_t{k} * kPatchColumns + 1];
        const Double3 o = (vector(k, 2) - centre) * (1 / unit), a = vector(k, 5) * (1 / unit),
                      across = vector(k, 8) * (1 / unit), n = cross(a, across);
        const bool round = kind_of(k) == PatchKind::kSphere;
        const Double3 b = round ? Double3{side, 0, 0} : across;
        const Double3 front = length(n) > 0 ? normalised(n) * side : n;
        const Double3 vectors[] = {o, a, b, front};
        const auto plane = [&] {  // of the rounded normal
            const auto rounded = [](double x) {
                return static_cast<double>(static_cast<float>(x));
            };
            return dot({rounded(front.x), rounded(front.y), rounded(front.z)}, o);
        };
        const double last[] = {static_cast<double>(kind_of(k)),
                               areas[k] > 0 ? areas[k] / total / ((end - begin) * 0x1p-24) : 0,
                               round ? 0 : plane(),
                               round ? kBefore * (largest(o) + largest(a)) : 0};
        float* out = meter_patches.data() + count + size_t{k} * kPatchFloats;
        for (uint32_t v = 0; v < 4; ++v) {
            for (int c = 0; c < 3; ++c) out[4 * v + c] = static_cast<float>(vectors[v][c]);
            out[4 * v + 3] = static_cast<float>(last[v]);
        }
    }
    m.patches = meter_patches.data(), m.guides = meter_guides.data();
    view.features |= kLens;
}

}  // namespace veriray
