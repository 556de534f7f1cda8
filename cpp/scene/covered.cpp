// Flat lamps that something opaque covers so closely that shadow rays would end before it.
#include "scene/box_pairs.h"

namespace veriray {
namespace {

// A shadow ray ends before its lamp by the lamp's offset and 2^-21 of its length, which is below 4.
constexpr double kNear = 0x1p-19;
// Of planes as close as this the first primitive is met.
constexpr double kOnePlane = 0x1p-22;
// The share of a lamp that may be covered and is sampled all the same: neighbours whose edges
// differ by rounding overlap. So much of its light may come through the cover.
constexpr double kSliver = 1e-6;

// The share of a polygon that another one of its plane covers; n: the plane's normal. Both convex.
double covered_share(const Flat& a, const Flat& b, Double3 n) {
    std::vector<Double3> rest(a.v.begin(), a.v.begin() + a.corners), kept;
    const double turn = dot(b.area_vector(), n) < 0 ? -1 : 1;
    for (uint32_t k = 0; k < b.corners && !rest.empty(); ++k) {
        const Double3 p = b.v[k], inward = cross(n, b.v[(k + 1) % b.corners] - p) * turn;
        kept.clear();
        for (size_t i = 0; i < rest.size(); ++i) {
            const Double3 from = rest[i], to = rest[(i + 1) % rest.size()];
            const double x = dot(inward, from - p), y = dot(inward, to - p);
            if (x >= 0) kept.push_back(from);
            if ((x >= 0) != (y >= 0)) kept.push_back(from + (to - from) * (x / (x - y)));
        }
        rest.swap(kept);
    }
    double area = 0;
    for (size_t i = 1; i + 1 < rest.size(); ++i)
        area += 0.5 * dot(n, cross(rest[i] - rest[0], rest[i + 1] - rest[0]));
    return std::abs(area) / length(a.area_vector());
}

}  // namespace

std::vector<uint8_t> HostScene::covered(const SceneInput& in,
                                        const std::vector<AreaLight>& lights) const {
    std::vector<uint8_t> hidden(lights.size());
    std::vector<uint32_t> flat;
    for (uint32_t k = 0; k < lights.size(); ++k)
        if (sources[lights[k].primitive].group == kTriangleGroup) flat.push_back(k);
    const Double3 near{kNear, kNear, kNear};
    const auto around_lamp = [&](size_t k) {
        const Box box = box_of(shape_of(in, lights[flat[k]]));
        return Box{box.low - near, box.high + near};
    };
    const auto look = [&](size_t k, size_t i) {
        const AreaLight& light = lights[flat[k]];
        const std::atomic_ref<uint8_t> found(hidden[flat[k]]);
        if (found || sources[i].group != kTriangleGroup || i == light.primitive ||
            i == light.other || lets_through(in, kTriangleGroup, sources[i].row))
            return true;
        const Flat lamp = shape_of(in, light), other = light_shape(in, static_cast<uint32_t>(i));
        const Double3 n = normalised(lamp.area_vector()), m = normalised(other.area_vector());
        double high = 0, sum = 0;  // of the lamp over the other's plane
        for (uint32_t c = 0; c < lamp.corners; ++c) {
            const double height = dot(m, lamp.v[c] - other.v[0]);
            high = std::max(high, std::abs(height)), sum += height;
        }
        const double before = -sum / lamp.corners * (dot(m, n) < 0 ? -1 : 1);
        if (high <= kNear &&
            (before > kOnePlane || (before >= -kOnePlane && i < light.primitive)) &&
            covered_share(lamp, other, n) > kSliver)
            found = 1;
        return true;
    };
    box_pairs(
        flat.size(), around_lamp, sources.size(), [&](size_t i) { return box_around(in, i); },
        look);
    return hidden;
}

// Those that are not covered stay in the list.
std::vector<AreaLight> HostScene::take_covered(const SceneInput& in,
                                               std::vector<AreaLight>& lights) {
    if (covered_.size() != lights.size()) covered_ = covered(in, lights);
    std::vector<AreaLight> seen, hidden;
    for (size_t k = 0; k < lights.size(); ++k) (covered_[k] ? hidden : seen).push_back(lights[k]);
    lights.swap(seen);
    return hidden;
}

}  // namespace veriray
