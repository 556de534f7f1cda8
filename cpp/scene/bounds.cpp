// Boxes of a large scene.
#include "scene/bounds.h"

#include <algorithm>

#include "scene/thread_pool.h"

namespace veriray {
namespace {

constexpr size_t kRun = SceneBounds::kRun, kGroup = 64;  // runs of a group
// More than the rounding of a depth, as a share of its terms.
constexpr double kDepthRounding = 0x1p-48;
constexpr Box kNothing{{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

// What a primitive is, and its row.
struct Primitive {
    ShapeGroup group;
    size_t row;
};
Primitive primitive(const SceneInput& in, size_t i) {
    if (i < in.triangles.count) return {kTriangleGroup, i};
    i -= in.triangles.count;
    return i < in.spheres.count ? Primitive{kSphereGroup, i}
                                : Primitive{kDiskGroup, i - in.spheres.count};
}
std::array<Double3, 3> corners(const SceneInput& in, size_t row) {
    const uint32_t* index = in.triangles.data + 3 * row;
    return {row3(in.vertices, index[0]), row3(in.vertices, index[1]), row3(in.vertices, index[2])};
}
Double3 sphere_centre(const SceneInput& in, size_t row) {
    const double* s = in.spheres.data + 4 * row;
    return {s[0], s[1], s[2]};
}

Box box_of(const SceneInput& in, Primitive p) {
    if (p.group == kTriangleGroup) {
        const auto v = corners(in, p.row);
        return around({v[0], v[0]}, around({v[1], v[1]}, {v[2], v[2]}));
    }
    const bool ball = p.group == kSphereGroup;
    const double r = ball ? in.spheres.data[4 * p.row + 3] : 0;
    const Double3 c = ball ? sphere_centre(in, p.row) : row3(in.disks, 3 * p.row);
    const Double3 reach =
        ball ? Double3{r, r, r}
             : ellipse_reach(row3(in.disks, 3 * p.row + 1), row3(in.disks, 3 * p.row + 2));
    return {c - reach, c + reach};
}

// A lower bound of the distance of a point, not below that of the primitive's box.
double distance(const SceneInput& in, Primitive i, Double3 p) {
    const double gap = std::sqrt(squared_gap({p, p}, box_of(in, i)));
    const auto plane = [&](Double3 at, Double3 n) {
        return length(n) > 0 ? std::max(gap, std::abs(dot(normalised(n), p - at))) : gap;
    };
    if (i.group == kTriangleGroup) {
        const auto v = corners(in, i.row);
        return plane(v[0], cross(v[1] - v[0], v[2] - v[0]));
    }
    if (i.group == kSphereGroup)
        return std::max(
            gap, std::abs(length(p - sphere_centre(in, i.row)) - in.spheres.data[4 * i.row + 3]));
    return plane(row3(in.disks, 3 * i.row),
                 cross(row3(in.disks, 3 * i.row + 1), row3(in.disks, 3 * i.row + 2)));
}

// The least depth along an axis.
double least_depth(const SceneInput& in, Primitive i, Double3 from, Double3 axis) {
    const auto depth = [&](Double3 p) { return dot(p - from, axis); };
    if (i.group == kTriangleGroup) {
        const auto v = corners(in, i.row);
        return std::min({depth(v[0]), depth(v[1]), depth(v[2])});
    }
    if (i.group == kSphereGroup)
        return depth(sphere_centre(in, i.row)) - in.spheres.data[4 * i.row + 3];
    return depth(row3(in.disks, 3 * i.row)) -
           ellipse_reach(row3(in.disks, 3 * i.row + 1), row3(in.disks, 3 * i.row + 2), axis);
}

}  // namespace

Box box_around(const SceneInput& in, size_t i) { return box_of(in, primitive(in, i)); }
Box box_around(const SceneInput& in, ShapeGroup group, size_t row) {
    return box_of(in, {group, row});
}

SceneBounds::SceneBounds(const SceneInput& in)
    : count_(in.triangles.count + in.spheres.count + in.disks.count),
      runs_((count_ + kRun - 1) / kRun, kNothing),
      groups_((runs_.size() + kGroup - 1) / kGroup, kNothing),
      all_(kNothing) {
    const uint32_t threads = std::max(1u, std::thread::hardware_concurrency());
    parallel(threads, groups_.size(), {}, [&](uint32_t, uint64_t g) {
        for (size_t r = g * kGroup; r < std::min(runs_.size(), (g + 1) * kGroup); ++r) {
            Box box = kNothing;
            for (size_t i = r * kRun; i < std::min(count_, (r + 1) * kRun); ++i)
                box = around(box, box_of(in, primitive(in, i)));
            runs_[r] = box;
            groups_[g] = around(groups_[g], box);
        }
    });
    for (const Box& group : groups_) all_ = around(all_, group);
}

template <class Skip, class Visit>
bool SceneBounds::each(Skip skip, Visit visit) const {
    for (size_t g = 0; g < groups_.size(); ++g) {
        if (skip(groups_[g])) continue;
        for (size_t r = g * kGroup; r < std::min(runs_.size(), (g + 1) * kGroup); ++r) {
            if (skip(runs_[r])) continue;
            for (size_t i = r * kRun; i < std::min(count_, (r + 1) * kRun); ++i)
                if (!visit(i)) return false;
        }
    }
    return true;
}

double SceneBounds::nearest(const SceneInput& in, Double3 p) const {
    const auto gap = [&](const Box& box) { return std::sqrt(squared_gap({p, p}, box)); };
    double least = INFINITY;
    const auto look = [&](size_t i) {
        least = std::min(least, distance(in, primitive(in, i), p));
        return true;
    };
    // From the run whose box is nearest on, so that most others are skipped.
    size_t first = 0;
    for (size_t r = 1; r < runs_.size(); ++r)
        if (gap(runs_[r]) < gap(runs_[first])) first = r;
    for (size_t i = first * kRun; i < std::min(count_, (first + 1) * kRun); ++i) look(i);
    each([&](const Box& box) { return gap(box) >= least; }, look);
    return least;
}

bool SceneBounds::reaches(const SceneInput& in, Double3 from, Double3 axis, double limit) const {
    const auto beyond = [&](const Box& box) {
        double low = 0, terms = 0;
        for (int k = 0; k < 3; ++k) {
            const double a = axis[k] * (box.low[k] - from[k]),
                         b = axis[k] * (box.high[k] - from[k]);
            low += std::min(a, b);
            terms += std::max(std::abs(a), std::abs(b));
        }
        return low - kDepthRounding * terms > limit;
    };
    return !each(beyond, [&](size_t i) {
        return !(least_depth(in, primitive(in, i), from, axis) <= limit);
    });
}

}  // namespace veriray
