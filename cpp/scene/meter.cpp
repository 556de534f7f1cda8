// The table of a camera whose rays begin at, or go to, a shape.
#include <algorithm>
#include <optional>

#include "scene/intervals.h"
#include "scene/scene.h"

namespace veriray {
namespace {

// Rays begin that far before a patch whose face is not known, times its largest coordinate: 16
// roundings of that.
constexpr double kBefore = 0x1p-20;

// The largest number of pairs of patches and faces that are examined.
constexpr size_t kMostMatches = size_t{1} << 24;

Double3 rounded(Double3 p) {
    const auto one = [](double x) { return static_cast<double>(static_cast<float>(x)); };
    return {one(p.x), one(p.y), one(p.z)};
}
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
    // The face that a flat patch is, or a part of it.
    const auto face_of = [&](uint32_t k) -> std::optional<uint32_t> {
        if (size_t{count} * view.first_sphere > kMostMatches) return {};
        const Double3 o = vector(k, 2), a = vector(k, 5), b = vector(k, 8);
        const double close = 1e-12 * (largest(o) + largest(a) + largest(b));
        const auto same = [&](Double3 p, Double3 q) { return largest(p - q) <= close; };
        for (uint32_t i = 0; i < view.first_sphere; ++i) {
            const PrimitiveSource& s = sources[i];
            if ((s.group == kDiskGroup) != (kind_of(k) == PatchKind::kDisk)) continue;
            const auto axis = [&](uint32_t c) { return row3(in.disks, 3 * s.row + c); };
            const auto is_corner = [&](uint32_t c) {
                const Double3 p = row3(in.vertices, in.triangles.data[3 * s.row + c]);
                return same(p, o) || same(p, o + a) || same(p, o + b) ||
                       (kind_of(k) == PatchKind::kParallelogram && same(p, o + a + b));
            };
            if (s.group == kDiskGroup ? same(axis(0), o) && same(axis(1), a) && same(axis(2), b)
                                      : is_corner(0) && is_corner(1) && is_corner(2))
                return i;
        }
        return {};
    };
    for (uint32_t k = 0; k < count; ++k) {
        const double end = meter_patches[k], begin = k ? meter_patches[k - 1] : 0;
        const double side = rows.data[size_t{k} * kPatchColumns + 1];
        const Double3 o = (vector(k, 2) - centre) * (1 / unit), a = vector(k, 5) * (1 / unit),
                      across = vector(k, 8) * (1 / unit), n = cross(a, across);
        const bool round = kind_of(k) == PatchKind::kSphere;
        const Double3 b = round ? Double3{side, 0, 0} : across;
        const double far = largest(o) + largest(a) + (round ? 0 : largest(b));
        Double3 front = length(n) > 0 ? normalised(n) * side : n;
        double plane = dot(rounded(front), o), before = kBefore * far;
        if (const auto face = round ? std::nullopt : face_of(k)) {
            const auto number = [&](uint32_t c) { return double{column(*face, c)}; };
            const Double3 own{number(kPrimN), number(kPrimN + 1), number(kPrimN + 2)};
            const double turn = dot(own, front) < 0 ? -1 : 1;
            front = own * turn, plane = number(kPrimPlane) * turn;
            before = std::max(number(kPrimOffset), 0.);
        }
        const Double3 vectors[] = {o, a, b, front};
        const double last[] = {static_cast<double>(kind_of(k)),
                               areas[k] > 0 ? areas[k] / total / ((end - begin) * 0x1p-24) : 0,
                               round ? 0 : plane, before};
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
