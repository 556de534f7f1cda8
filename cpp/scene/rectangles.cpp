// Area lights as they are sampled: joins pairs of triangles, and finds the rectangles that are
// sampled by solid angle where that is large: in a tree all, without one those near to something.
#include <algorithm>

#include "scene/scene.h"
#include "scene/thread_pool.h"

namespace veriray {
namespace {

// Tolerances for the corners of a rectangle: in units of the root of its area, and what rounding
// moves them by, as far as that is below the second. What is lit by solid angle from a thousandth
// of the root away is off by the first times 1000.
constexpr double kSquare = 0x1p-18, kRoundSquare = 0x1p-15, kRoundCorners = 0x1p-22;
// Of a pair that is sampled as a parallelogram, in units of its shorter edge: by this share at most
// its light moves.
constexpr double kClosed = 0x1p-20;
// Near: the squared gap is less than this share of the area.
constexpr double kNear = 0.24;

// How far the fourth corner is from where a parallelogram has it.
double gap_of(const Flat& f) { return length(f.v[1] - f.v[0] + f.v[3] - f.v[2]); }

bool closes(const Flat& f) {
    const double shorter = std::min(length(f.v[1] - f.v[0]), length(f.v[3] - f.v[0]));
    return f.corners == 4 && gap_of(f) <= kClosed * shorter;
}

bool rectangular(const Flat& f) {
    if (f.corners != 4) return false;
    const Double3 a = f.v[1] - f.v[0], b = f.v[3] - f.v[0];
    const double longer = std::max(length(a), length(b)), root = std::sqrt(length(cross(a, b))),
                 most = std::clamp(kRoundCorners, kSquare * root, kRoundSquare * root);
    return gap_of(f) <= most && std::abs(dot(a, b)) <= most * longer;
}

}  // namespace

// Whether, by boxes, something in front of the light comes nearer to it than half the square root
// of its area. Things in its plane, to 2^-8 of that root, do not count.
bool HostScene::lights_closely(const SceneInput& in, const Flat& light) const {
    const Double3 n = normalised(light.area_vector());
    const double area = length(light.area_vector());
    const double plane = dot(n, light.v[0]) + 0x1p-8 * std::sqrt(area);
    const Box box = box_of(light);
    for (uint32_t i = 0; i < sources.size(); ++i) {
        const Box other = box_around(in, i);
        if (reach(other, n) > plane && squared_gap(box, other) < kNear * area) return true;
    }
    return false;
}

Flat HostScene::shape_of(const SceneInput& in, const AreaLight& light) const {
    const Flat own = light_shape(in, light.primitive);
    if (light.other == light.primitive) return own;
    Flat joined{};
    join_coplanar(own, light_shape(in, light.other), joined);
    return joined;
}

// Normalised.
double HostScene::area_of(const SceneInput& in, size_t primitive) const {
    constexpr double kPi = 3.14159265358979323846;
    const PrimitiveSource& s = sources[primitive];
    if (primitive < flats_.size()) return length(flats_[primitive].area_vector());
    if (s.group == kTriangleGroup) return length(triangle(in, s.row).area_vector());
    if (s.group == kDiskGroup) {
        const Double3 a = row3(in.disks, 3 * s.row + 1) * (1 / unit),
                      b = row3(in.disks, 3 * s.row + 2) * (1 / unit);
        return kPi * length(cross(a, b));
    }
    const double radius = in.spheres.data[4 * s.row + 3] / unit;
    return 4 * kPi * radius * radius;
}

std::vector<AreaLight> HostScene::area_lights(const SceneInput& in) const {
    std::vector<uint32_t> lit;
    std::vector<uint8_t> shines;  // by surface, of which there are few in a tree
    for (const SurfaceKey& key : surface_keys_.rows()) shines.push_back(std::get<1>(key) >= 0);
    if (std::find(shines.begin(), shines.end(), 1) != shines.end())
        lit = where(sources.size(),
                    [&](size_t i) { return shines[surface_of.empty() ? i : surface_of[i]] != 0; });
    std::vector<AreaLight> lights;
    for (size_t k = 0; k < lit.size(); ++k) {
        const uint32_t i = lit[k], next = k + 1 < lit.size() ? lit[k + 1] : i;
        AreaLight light{i, i, false, area_of(in, i)};
        if (sources[i].group == kTriangleGroup) {
            const Flat own = light_shape(in, i);
            Flat joined{};
            const bool pair = own.corners == 3 && next == i + 1 &&
                              sources[next].group == kTriangleGroup &&
                              sources[i].same_surface(sources[next]) &&
                              join_coplanar(own, light_shape(in, next), joined);
            const Flat& whole = pair ? joined : own;
            light.rectangle = rectangular(whole) && (flats_.empty() || lights_closely(in, whole));
            if (pair && (light.rectangle || closes(whole))) {
                light.other = next;
                light.area += area_of(in, next);
                ++k;
            }
        }
        lights.push_back(light);
    }
    return lights;
}

}  // namespace veriray
