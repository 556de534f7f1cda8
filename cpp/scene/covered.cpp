// Flat lamps that something opaque covers so closely that shadow rays would end before it.
#include <algorithm>
#include <atomic>
#include <cmath>

#include "scene/box_pairs.h"

namespace veriray {
namespace {

// A shadow ray ends before its lamp by the lamp's offset, 2^-20 at most, and by 2^-21 of its
// length, which is below 4.
constexpr double kNear = 0x1p-18;
// Of planes as close as this the first primitive is met, but for disks, of which either may be.
constexpr double kOnePlane = 0x1p-22;
// More lamps than this, or pairs of a lamp and something at it, are not examined.
constexpr size_t kMostLamps = 1 << 16, kMostPairs = 1 << 22;
// Share of a lamp's area below which an overlap is rounding; of a disk, its depth in radii.
constexpr double kSliver = 1e-6, kShallow = 0x1p-13;

// A flat primitive or lamp: its corners, or points on the rim and the half axes of an ellipse.
struct Face {
    std::vector<Double3> v;
    Double3 n, centre{}, a{}, b{};  // n: unit, of the front
    bool round = false;
};

Face face_of(const Flat& f) {
    return {{f.v.begin(), f.v.begin() + f.corners}, normalised(f.area_vector())};
}
Face ellipse(Double3 centre, Double3 a, Double3 b) {
    constexpr int kHalf = 64;  // points on a half of the rim, by the tangent of half the angle
    Face f{{}, normalised(cross(a, b)), centre, a, b, true};
    for (int k = 0; k < 2 * kHalf; ++k) {
        const double t = 2. * (k % kHalf) / kHalf - 1, side = k < kHalf ? 1 : -1;
        f.v.push_back(centre + (a * (1 - t * t) + b * (2 * t)) * (side / (1 + t * t)));
    }
    return f;
}

Double3 area_vector(const std::vector<Double3>& v) {
    Double3 sum{0, 0, 0};
    for (size_t i = 1; i + 1 < v.size(); ++i) sum = sum + cross(v[i] - v[0], v[i + 1] - v[0]) * 0.5;
    return sum;
}

// The share of a polygon that another one of its plane covers. Both convex.
double covered_share(const Face& a, const Face& b) {
    std::vector<Double3> rest = a.v, kept;
    const double turn = dot(area_vector(b.v), a.n) < 0 ? -1 : 1;
    for (size_t k = 0; k < b.v.size() && !rest.empty(); ++k) {
        const Double3 p = b.v[k], inward = cross(a.n, b.v[(k + 1) % b.v.size()] - p) * turn;
        kept.clear();
        for (size_t i = 0; i < rest.size(); ++i) {
            const Double3 from = rest[i], to = rest[(i + 1) % rest.size()];
            const double x = dot(inward, from - p), y = dot(inward, to - p);
            if (x >= 0) kept.push_back(from);
            if ((x >= 0) != (y >= 0)) kept.push_back(from + (to - from) * (x / (x - y)));
        }
        rest.swap(kept);
    }
    return length(area_vector(rest)) / length(area_vector(a.v));
}

// Whether a polygon of an ellipse's plane reaches into it: as seen in its half axes, where it is
// the unit disk.
bool reaches(const Face& round, const Face& other) {
    const Double3 n = cross(round.a, round.b);
    const double n2 = dot(n, n);
    const auto seen = [&](Double3 p) {
        const Double3 at = p - round.centre;
        return Double3{dot(cross(at, round.b), n) / n2, dot(cross(round.a, at), n) / n2, 0};
    };
    double least = INFINITY;
    bool left = true, right = true;  // of all edges
    for (size_t k = 0; k < other.v.size(); ++k) {
        const Double3 from = seen(other.v[k]),
                      along = seen(other.v[(k + 1) % other.v.size()]) - from;
        const double turn = along.y * from.x - along.x * from.y;
        left &= turn >= 0, right &= turn <= 0;
        const double share = -dot(from, along) / std::max(dot(along, along), 0x1p-100);
        least = std::min(least, length(from + along * std::clamp(share, 0., 1.)));
    }
    return left || right || least < 1 - kShallow;
}

// Whether a face covers a part of a lamp. first: it comes before the lamp in number.
bool covers(const Face& face, const Face& lamp, bool first) {
    double high = 0, sum = 0;  // of the lamp over the face's plane
    for (const Double3 p : lamp.v) {
        const double height = dot(face.n, p - face.v[0]);
        high = std::max(high, std::abs(height)), sum += height;
    }
    if (!(high <= kNear)) return false;
    const double before =
        -sum / static_cast<double>(lamp.v.size()) * (dot(face.n, lamp.n) < 0 ? -1 : 1);
    const bool round = face.round || lamp.round;
    if (!(before > kOnePlane || (before >= -kOnePlane && (first || round)))) return false;
    return face.round   ? reaches(face, lamp)
           : lamp.round ? reaches(lamp, face)
                        : covered_share(lamp, face) > kSliver;
}

}  // namespace

// Those that are not covered stay in the list.
std::vector<AreaLight> HostScene::take_covered(const SceneInput& in,
                                               std::vector<AreaLight>& lights) const {
    if (lights.size() > kMostLamps) return {};
    const auto disk = [&](uint32_t i) {
        const size_t row = 3 * size_t{sources[i].row};
        return ellipse((row3(in.disks, row) - centre) * (1 / unit),
                       row3(in.disks, row + 1) * (1 / unit), row3(in.disks, row + 2) * (1 / unit));
    };
    const auto around_lamp = [&](size_t k) {
        const Box box =
            around(box_around(in, lights[k].primitive), box_around(in, lights[k].other));
        const Double3 more{kNear, kNear, kNear};
        return Box{box.low - more, box.high + more};
    };
    std::vector<uint8_t> hidden(lights.size(), 0);
    std::atomic<size_t> pairs(0);
    const bool all = box_pairs(
        lights.size(), around_lamp, sources.size(), [&](size_t i) { return box_around(in, i); },
        [&](size_t k, size_t j) {
            const AreaLight& light = lights[k];
            const uint32_t i = static_cast<uint32_t>(j);
            const ShapeGroup own = sources[light.primitive].group, group = sources[i].group;
            if (own == kSphereGroup || group == kSphereGroup || i == light.primitive ||
                i == light.other || lets_through(in, group, sources[i].row))
                return true;
            const Face lamp =
                own == kDiskGroup ? disk(light.primitive) : face_of(shape_of(in, light));
            const Face face = group == kDiskGroup ? disk(i) : face_of(light_shape(in, i));
            if (covers(face, lamp, i < light.primitive))
                std::atomic_ref<uint8_t>(hidden[k]).store(1, std::memory_order_relaxed);
            return ++pairs < kMostPairs;
        });
    if (!all) return {};
    std::vector<AreaLight> out, rest;
    for (size_t k = 0; k < lights.size(); ++k) (hidden[k] ? out : rest).push_back(lights[k]);
    lights.swap(rest);
    return out;
}

}  // namespace veriray
