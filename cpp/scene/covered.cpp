// Flat lamps that something opaque covers so closely that shadow rays would end before it.
#include "scene/scene.h"

namespace veriray {
namespace {

// A shadow ray ends before its lamp by the lamp's offset and 2^-21 of its length, which is below 4.
constexpr double kNear = 0x1p-19;
// Of planes as close as this the first primitive is met.
constexpr double kOnePlane = 0x1p-22;
constexpr size_t kMostPairs = 1 << 20;
// Share of a lamp's area below which an overlap is rounding.
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

bool HostScene::covered(const SceneInput& in, const AreaLight& light) const {
    if (sources[light.primitive].group != kTriangleGroup) return false;
    const Flat lamp = shape_of(in, light);
    const Double3 n = normalised(lamp.area_vector());
    for (uint32_t i = 0; i < sources.size(); ++i) {
        if (sources[i].group != kTriangleGroup || i == light.primitive || i == light.other ||
            lets_through(in, kTriangleGroup, sources[i].row))
            continue;
        const Flat other = light_shape(in, i);
        const Double3 m = normalised(other.area_vector());
        double high = 0, sum = 0;  // of the lamp over the other's plane
        for (uint32_t k = 0; k < lamp.corners; ++k) {
            const double height = dot(m, lamp.v[k] - other.v[0]);
            high = std::max(high, std::abs(height)), sum += height;
        }
        if (!(high <= kNear)) continue;
        const double before = -sum / lamp.corners * (dot(m, n) < 0 ? -1 : 1);
        if (before > kOnePlane || (before >= -kOnePlane && i < light.primitive))
            if (covered_share(lamp, other, n) > kSliver) return true;
    }
    return false;
}

// Those that are not covered stay in the list.
std::vector<AreaLight> HostScene::take_covered(const SceneInput& in,
                                               std::vector<AreaLight>& lights) const {
    if (lights.size() * sources.size() > kMostPairs) return {};
    const auto hidden = std::stable_partition(lights.begin(), lights.end(),
                                              [&](const AreaLight& a) { return !covered(in, a); });
    std::vector<AreaLight> out(hidden, lights.end());
    lights.erase(hidden, lights.end());
    return out;
}

}  // namespace veriray
