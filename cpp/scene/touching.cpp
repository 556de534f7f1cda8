// Bodies that touch: planes that differ only by rounding are separated by more than that.
//
// If a surface that lets light through (glass, null, thin, masked, a medium's boundary) lies in the
// same plane as another one, as a box on a floor does, rounding would decide the order in which
// they are met, and a path that leaves one by its offset would begin beyond the other. So the
// planes of such surfaces are moved, into the body or off an opaque surface that they lie on. They
// are then separated by twice the offset of paths that leave them, and, unless they are only
// borders of media (DirectLight::swapped), by what rays from 64 sizes of the body resolve. The
// order is that of the exact input; of bodies in one plane the smaller lies within the larger, and
// of equal ones the later within the earlier; sheets lie outside. A surface keeps its edges, so
// bodies stay closed.
#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <numeric>
#include <tuple>
#include <vector>

#include "scene/bodies.h"
#include "scene/box_pairs.h"
#include "scene/edge_hash.h"
#include "scene/touching.h"

namespace veriray {
namespace {

// The largest move of a plane; triangles then stay within their boxes, which are widened by that
// over kOfSlack. Where five surfaces or more lie in one plane it may be kDeepest times as large.
constexpr double kOfSlack = 0.75, kMostMoved = kOfSlack * static_cast<double>(kMovedSlack);
constexpr double kDeepest = 8;
// The least terms that count. On an axis-parallel plane through the origin they vanish, but
// rounding takes points off it by up to 2^-22, and paths leave it by an offset in proportion to
// that move.
constexpr double kLeastTerms = 0x1p-20;
static_assert(kLeastTerms >= 0x1p-22 * static_cast<double>(kLocalMove));
// Beyond this difference, 45 degrees, rays that leave one plane do not reach the other.
constexpr double kAcross = 0.75;
// The largest sine between a face and an opaque ball below it, where they are closest, for the face
// to move off the ball. Into the body, of light that comes along the ball up to a quarter of its
// square meets what the face should cover; out of it, a strip by the distance over it lies in the
// ball.
constexpr double kOnBall = 0x1p-5;
// The largest number of pairs that are examined; beyond it, each primitive that lets light through
// is paired only with the largest of all, and with those of other bodies around its own.
constexpr size_t kMostPairs = size_t{1} << 26;
// Corners of turned faces are off by some units of float64 where they were computed, and by half of
// one of float32 where they are numbers of that, as in most files of meshes. These shares of their
// coordinates are 8,192 and 8 such units. Faces across an axis are exact.
constexpr double kRoundedCorner = 0x1p-40, kRoundedFile = 0x1p-21;
// The largest number of bodies near which small faces are looked for, too.
constexpr size_t kMostBodies = 64;

// A plane n.p + w = 0.
struct Plane {
    Double3 n;
    double w;

    double over(Double3 p) const { return dot(n, p) + w; }
};

// Two primitives that count as one plane where they overlap.
struct Touch {
    uint32_t own, other;  // own: lets light through, and is moved
    double turn;          // -1: they face in opposite directions
    bool out;             // own must lie beyond the other along its own normal, else before it
    bool rests;           // own lies on an opaque face of its direction
    bool above;           // own lies over another of its direction that lets light through
    bool far;             // they do not touch, unless one of them is moved
    bool crosses;         // rays that leave one by its offset may pass the other
    double apart;         // the distance by which it does now
    double want;

    // A fixed order, in whatever order the threads find touches.
    bool operator<(const Touch& b) const {
        return std::pair(own, other) < std::pair(b.own, b.other);
    }
};

// Without a tree, rays may leave an opaque face by kEdgeSlack, and its plane lies kPlaneSlack
// behind it.
constexpr double kCoarse = 2 * static_cast<double>(kEdgeSlack);

// The gap along an axis at which boxes still count as overlapping.
double margin(const Box& b, int k, double coarse) {
    return 2 * kParted * (1 + std::max(std::abs(b.low[k]), std::abs(b.high[k]))) + coarse;
}

// The box in which overlaps are looked for.
Box widened(const Box& b, double coarse) {
    const Double3 by{margin(b, 0, coarse), margin(b, 1, coarse), margin(b, 2, coarse)};
    return {b.low - by * 2, b.high + by * 2};
}

bool overlap(const Box& a, const Box& b, double coarse, Box& out) {
    double low[3], high[3];
    for (int k = 0; k < 3; ++k) {
        low[k] = std::max(a.low[k], b.low[k]), high[k] = std::min(a.high[k], b.high[k]);
        if (low[k] > high[k] + margin(a, k, coarse)) return false;
        if (low[k] > high[k]) std::swap(low[k], high[k]);
    }
    out = {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
    return true;
}

// The least and largest |g.p + c| over a box.
std::pair<double, double> heights(const Box& b, Double3 g, double c) {
    double low = c, high = c;
    for (int k = 0; k < 3; ++k) {
        low += std::min(g[k] * b.low[k], g[k] * b.high[k]);
        high += std::max(g[k] * b.low[k], g[k] * b.high[k]);
    }
    return {std::max({low, -high, 0.0}), std::max(std::abs(low), std::abs(high))};
}

// The unrounded plane of a primitive.
Plane exact_plane(const SceneInput& in, Double3 centre, double unit, const PrimitiveSource& s,
                  Double3 front) {
    Double3 p[3];
    for (uint32_t k = 0; k < 3; ++k)
        p[k] = s.group == kDiskGroup
                   ? row3(in.disks, 3 * s.row + k) * (1 / unit)
                   : (row3(in.vertices, in.triangles.data[3 * s.row + k]) - centre) * (1 / unit);
    Double3 n = s.group == kDiskGroup ? cross(p[1], p[2]) : cross(p[1] - p[0], p[2] - p[0]);
    if (s.group == kDiskGroup) p[0] = p[0] - centre * (1 / unit);
    if (!(length(n) > 0)) return {front, -dot(front, p[0])};
    n = normalised(n) * (dot(n, front) < 0 ? -1.0 : 1.0);
    return {n, -dot(n, p[0])};
}

// What rounding of its corners may take a face's plane off at most.
double corner_rounding(const SceneInput& in, double unit, const PrimitiveSource& s, Double3 n) {
    const double most = std::max({std::abs(n.x), std::abs(n.y), std::abs(n.z)});
    if (most == std::abs(n.x) + std::abs(n.y) + std::abs(n.z)) return 0;
    bool single = true;
    double size = 0;
    for (uint32_t c = 0; c < 3; ++c) {
        const bool disk = s.group == kDiskGroup;
        const Double3 p = disk ? row3(in.disks, 3 * s.row + c)
                               : row3(in.vertices, in.triangles.data[3 * s.row + c]);
        double terms = 0;
        for (int k = 0; k < 3; ++k) {
            single = single && static_cast<double>(static_cast<float>(p[k])) == p[k];
            terms += std::abs(n[k] * p[k]);
        }
        size = disk ? size + terms : std::max(size, terms);
    }
    return size / unit * (single ? kRoundedFile : kRoundedCorner);
}

// The point of a convex face with normal n that is closest to a point p of its plane.
Double3 nearest_on(const Flat& f, Double3 n, Double3 p) {
    bool left = false, right = false;
    Double3 best = p;
    double least = INFINITY;
    for (uint32_t k = 0; k < f.corners; ++k) {
        const Double3 at = f.v[k], edge = f.v[(k + 1) % f.corners] - at;
        const double side = dot(cross(edge, p - at), n);
        left |= side > 0, right |= side < 0;
        const Double3 q = at + edge * std::clamp(dot(p - at, edge) / dot(edge, edge), 0.0, 1.0);
        if (const double off = length(p - q); off < least) least = off, best = q;
    }
    return left && right ? best : p;
}

// The same of a disk, whose half axes are a and b; of an ellipse, one towards its centre.
Double3 nearest_on_disk(Double3 middle, Double3 a, Double3 b, Double3 p) {
    const Double3 d = p - middle;
    const double u = dot(d, a) / dot(a, a), v = dot(d, b) / dot(b, b);
    const double out = std::sqrt(u * u + v * v);
    return out > 1 ? middle + d * (1 / out) : p;
}

Box ball_box(const SceneInput& in, size_t k, Double3 centre, double unit) {
    const Double3 c = ball_centre(in, k, centre, unit);
    const double r = in.spheres.data[4 * k + 3] / unit;
    return {c - Double3{r, r, r}, c + Double3{r, r, r}};
}

}  // namespace

bool covers_partly(const SceneInput& in, uint32_t material) {
    return in.opacity.data[material] < 1 || in.opacity_texture.data[material] >= 0;
}
bool passes_straight(const SceneInput& in, uint32_t material) {
    return in.either(material, [&](uint32_t m) {
        return closure_traits(in.material_kind.data[m]).passes || covers_partly(in, m);
    });
}
bool clear_material(const SceneInput& in, uint32_t material) {
    return in.either(material, [&](uint32_t m) {
        return closure_traits(in.material_kind.data[m]).lets_through() || covers_partly(in, m);
    });
}

double terms(const Box& b, Double3 n) {
    double sum = 0;
    for (int k = 0; k < 3; ++k)
        sum += std::abs(n[k]) * std::max(std::abs(b.low[k]), std::abs(b.high[k]));
    return sum;
}

// The plane in the record that the ray tests use.
float* HostScene::plane_record(uint32_t i) {
    if (!records.empty())
        return &records[static_cast<size_t>(i) * kRecordFloats] +
               (sources[i].group == kTriangleGroup ? kRecordPlane : 0);
    if (i < view.quad_count) return view.quads + kQuadFloats * i;
    i -= view.quad_count;
    if (i < view.polygon_count) return view.polygons + kPolygonFloats * i;
    return view.disks + kDiskFloats * (i - view.polygon_count);
}

// Moves the plane of a primitive along its normal.
void HostScene::move_plane(uint32_t i, double by) {
    const float w = static_cast<float>(-double{column(i, kPrimPlane)} - by);
    column(i, kPrimPlane) = -w;
    plane_record(i)[3] = w;
}

bool HostScene::lets_through(const SceneInput& in, ShapeGroup group, uint32_t row) const {
    return clear_material(in, in.material(group).data[row]) || in.boundary(group).data[row] >= 0;
}

// The `count` faces of largest extent among the first `planar` primitives.
std::vector<uint32_t> HostScene::largest_faces(const SceneInput& in, size_t planar,
                                               size_t count) const {
    std::vector<uint32_t> faces(planar);
    std::iota(faces.begin(), faces.end(), 0u);
    if (count >= planar) return faces;
    faces.clear();
    if (count == 0) return faces;
    std::vector<double> extent(planar);
    in_chunks(kAllThreads, planar, [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i) {
            const Box box = box_around(in, i);
            const Double3 size = box.high - box.low;
            extent[i] = std::max(std::max(size.x, size.y), size.z);
        }
    });
    std::vector<double> sorted = extent;
    const auto last = sorted.begin() + static_cast<ptrdiff_t>(count) - 1;
    std::nth_element(sorted.begin(), last, sorted.end(), std::greater<>());
    // Of faces as large as the last one taken, the first in order.
    auto equal = std::count(sorted.begin(), last + 1, *last);
    for (uint32_t i = 0; i < planar; ++i)
        if (extent[i] > *last || (extent[i] == *last && equal-- > 0)) faces.push_back(i);
    return faces;
}

void HostScene::part_touching(const SceneInput& in) {
    bool any = in.boundaries.count > 0;
    for (uint32_t m = 0; m < in.material_kind.count; ++m) any |= clear_material(in, m);
    const int32_t* emission = in.sphere_emission.data;
    if (any || std::any_of(emission, emission + in.spheres.count, [](int32_t e) { return e >= 0; }))
        part_concentric(in);
    if (any && !part_faces(in, kMostMoved)) part_faces(in, kDeepest * kMostMoved);
}

// Moves faces by no more than that; false, and none is moved, if kMostMoved is too little.
bool HostScene::part_faces(const SceneInput& in, double most_moved) {
    const size_t planar = view.first_sphere;
    const auto is_clear = [&](uint32_t i) {
        return lets_through(in, sources[i].group, sources[i].row);
    };
    const auto is_border = [&](uint32_t i) {  // and nothing else: light goes straight through
        return !in.either(sources[i].material, [&](uint32_t m) {
            return closure_traits(in.material_kind.data[m]).reflects;
        });
    };
    std::vector<uint32_t> clear;
    for (uint32_t i = 0; i < planar; ++i)
        if (is_clear(i)) clear.push_back(i);
    if (clear.empty()) return true;
    const auto rounded_plane = [&](uint32_t i) {
        const auto n = [&](uint32_t k) { return static_cast<double>(column(i, kPrimN + k)); };
        return Plane{{n(0), n(1), n(2)}, -static_cast<double>(column(i, kPrimPlane))};
    };
    const auto exact = [&](uint32_t i) {
        return exact_plane(in, centre, unit, sources[i], rounded_plane(i).n);
    };
    Bodies bodies;
    for (uint32_t i = 0; i < planar; ++i)
        bodies.add(sources[i], box_around(in, i), rounded_plane(i).n, is_clear(i));
    const std::vector<uint32_t> large =
        largest_faces(in, planar, std::min(planar, kMostPairs / clear.size()));
    // Beyond them, faces of different bodies, one of which lets light through, where both are.
    std::vector<uint32_t> small, close;
    if (large.size() < planar && bodies.all().size() <= kMostBodies) {
        std::vector<bool> is_large(planar, false);
        for (const uint32_t i : large) is_large[i] = true;
        for (uint32_t i = 0; i < planar; ++i) {
            const Box box = box_around(in, i);
            bool by_any = false, by_clear = false;
            for (const auto& [key, other] : bodies.all())
                if (&other != &bodies.of(i) && meet(widened(other.box, 0), box))
                    by_any = true, by_clear = by_clear || other.clear;
            if (by_clear && !is_large[i]) small.push_back(i);
            if (by_any && bodies.of(i).clear) close.push_back(i);
        }
    }
    // Whether the body of a face is of closed meshes and stops straight light. Asked only of those
    // that touch lamps.
    std::once_flag asked;
    std::map<SurfaceKey, uint64_t> edges_of;  // 0 of closed meshes
    const auto is_solid = [&](uint32_t i) {
        std::call_once(asked, [&] {
            const auto add = [&](ShapeGroup group, size_t count, const auto& edges) {
                SurfaceKey last{~0u, 0, 0};
                uint64_t* sum = nullptr;
                for (size_t k = 0; k < count; ++k) {
                    const SurfaceKey key{in.material(group).data[k], in.emission(group).data[k],
                                         in.boundary(group).data[k]};
                    if (key != last)
                        sum = lets_through(in, group, static_cast<uint32_t>(k)) ? &edges_of[key]
                                                                                : nullptr;
                    last = key;
                    if (sum) *sum += edges(k);
                }
            };
            add(kTriangleGroup, in.triangles.count,
                [&](size_t k) { return edges(triangle(in, k)); });
            add(kDiskGroup, in.disks.count, [](size_t) { return uint64_t{1}; });
        });
        const PrimitiveSource& s = sources[i];
        return edges_of.at({s.material, s.emission, s.boundary}) == 0 &&
               !passes_straight(in, s.material);
    };
    const bool flat = records.empty();
    const double further = most_moved - kMostMoved;  // what moved faces may come to
    std::vector<Touch> touches;
    std::vector<uint32_t> crossing;
    std::mutex mutex;
    const auto look = [&](uint32_t own, uint32_t other) {
        Box common;
        const bool other_clear = is_clear(other);
        const double coarse = flat && !other_clear ? kCoarse : 0;
        if (own == other ||
            !overlap(box_around(in, own), box_around(in, other), coarse + further, common))
            return true;
        const Plane a = rounded_plane(own), b = rounded_plane(other);
        const double turn = dot(a.n, b.n) < 0 ? -1 : 1;
        const double size = std::max(terms(common, a.n), terms(common, b.n));
        const Double3 g = b.n - a.n * turn;
        const double extent = bodies.of(own).size();
        const bool near = is_border(own) && (!other_clear || is_border(other));
        const double seen = near ? 0 : std::min(0.5, 32 * extent);
        const double want = kParted * (std::max(size, kLeastTerms) + seen);
        const PrimitiveSource &from = sources[own], &to = sources[other];
        const bool same = from.same_surface(to);
        if (turn > 0 && same) return true;
        const auto [least, most] = heights(common, g, b.w - a.w * turn);
        const bool parallel = !(length(g) > Bodies::kParallel);
        const double limit = 2 * want + coarse;
        // They meet along a line, and a ray from a point near it leaves one and not the other; or
        // they are closer than the rounding at their corners, if not than that here, and a ray that
        // leaves one by its offset may pass the other.
        const double leap = std::max(column(own, kPrimOffset), column(other, kPrimOffset));
        const bool crosses = !(length(g) > kAcross || least > std::max(limit, leap) ||
                               (same && !(turn < 0 && parallel)));
        const auto apart = [&] {
            const std::lock_guard lock(mutex);
            if (crosses) crossing.insert(crossing.end(), {own, other});
            return true;
        };
        if (!parallel || most > limit + (other_clear ? most_moved : 0)) return apart();
        const Double3 p = (common.low + common.high) * 0.5;
        const Plane a0 = exact(own), b0 = exact(other);
        const Polygon shared = common_part(outline(in, {own, own, false, 0}),
                                           outline(in, {other, other, false, 0}), a0.n);
        if (shared.empty()) return apart();  // side by side
        // How far `own` lies beyond the other along its own normal.
        Double3 at{};
        for (const Double3 q : shared) at = at + q * (1. / static_cast<double>(shared.size()));
        double beyond = b0.over(at) * turn - a0.over(at);
        const double rounding =
            corner_rounding(in, unit, from, a0.n) + corner_rounding(in, unit, to, b0.n);
        if (std::abs(beyond) <= std::max(1e-13 * size, rounding)) beyond = 0;
        Touch t{own, other, turn, false, false, false, most > limit, crosses, 0, want};
        if (turn < 0)
            t.out = same && beyond > 0;  // a thin body's two sides
        else if (other_clear)
            t.out = t.above = beyond > 0 || (beyond == 0 && bodies.holds(own, other));
        else
            t.out = t.rests = beyond >= 0;
        if (coarse > 0 && turn > 0 && !t.out) t.want += 2 * static_cast<double>(kPlaneSlack);
        // Shadow rays end before the lamp that a body touches (lights/light.h), but must meet the
        // body's face first.
        if (to.emission >= 0 && !near)
            t.want += static_cast<double>(kLocalOffset) *
                      (terms(box_around(in, other), b.n) + extent +
                       shadow_length(extent, turn < 0 && is_solid(own)));
        const double slope = heights(common, g, -dot(g, p)).second;
        t.apart = (t.out ? 1 : -1) * (b.over(p) * turn - a.over(p)) - slope;
        if (t.far && t.apart < t.want) return apart();
        const std::lock_guard lock(mutex);
        touches.push_back(t);
        return true;
    };
    const auto around_faces = [&](const std::vector<uint32_t>& faces) {
        return [&](size_t i) {
            return widened(box_around(in, faces[i]), (flat ? kCoarse : 0) + further);
        };
    };
    const auto boxes_of = [&](const std::vector<uint32_t>& faces) {
        return [&](size_t k) { return box_around(in, faces[k]); };
    };
    box_pairs(clear.size(), around_faces(clear), large.size(), boxes_of(large),
              [&](size_t i, size_t k) { return look(clear[i], large[k]); });
    if (!small.empty())
        box_pairs(close.size(), around_faces(close), small.size(), boxes_of(small),
                  [&](size_t i, size_t k) {
                      return &bodies.of(close[i]) == &bodies.of(small[k]) ||
                             look(close[i], small[k]);
                  });
    std::sort(touches.begin(), touches.end());
    // A face that rests on an opaque one of its direction moves off it, and off what rests there
    // too, unless a larger opaque body is before it, as a floor below a coat. Of others, a move
    // into the body takes precedence over a move off another surface.
    std::vector<double> move(planar, 0.0), rests_on(planar, 0.0), faces(planar, 0.0);
    std::vector<bool> inward(planar, false), rests(planar, false);
    for (const Touch& t : touches) {
        if (t.far || is_clear(t.other) || (t.out && !t.rests)) continue;
        double& size = (t.rests ? rests_on : faces)[t.own];
        size = std::max(size, bodies.of(t.other).size());
    }
    for (uint32_t i = 0; i < planar; ++i) rests[i] = rests_on[i] > 0 && rests_on[i] >= faces[i];
    for (const Touch& t : touches)
        if (!t.out && !t.far && !rests[t.own]) inward[t.own] = true;
    const auto nearest_point = [&](uint32_t i, Double3 n, Double3 p) {  // p: in the plane
        const uint32_t row = sources[i].row;
        if (sources[i].group != kDiskGroup)
            return nearest_on(flat ? flats_[i] : triangle(in, row), n, p);
        const auto row_of = [&](uint32_t k) { return row3(in.disks, 3 * row + k); };
        return nearest_on_disk((row_of(0) - centre) * (1 / unit), row_of(1) * (1 / unit),
                               row_of(2) * (1 / unit), p);
    };
    // So does one off an opaque ball below the face, as a planet, where the face would move out.
    std::vector<uint32_t> outward;
    for (const Touch& t : touches)
        if (!t.far && !inward[t.own] && (rests[t.own] || !t.above) &&
            (outward.empty() || outward.back() != t.own))
            outward.push_back(t.own);
    box_pairs(
        outward.size(), [&](size_t i) { return widened(box_around(in, outward[i]), 0); },
        in.spheres.count, [&](size_t k) { return ball_box(in, k, centre, unit); },
        [&](size_t i, size_t k) {
            if (lets_through(in, kSphereGroup, static_cast<uint32_t>(k))) return true;
            const uint32_t own = outward[i];
            const Box box = box_around(in, own);
            const Plane a = exact(own);
            const Double3 c = ball_centre(in, k, centre, unit);
            const double height = a.over(c);
            const Double3 foot = c - a.n * height;
            const Double3 nearest = nearest_point(own, a.n, foot);
            const double apart = length(c - nearest) - in.spheres.data[4 * k + 3] / unit;
            const double seen = std::min(0.5, 32 * bodies.of(own).size());
            const double want = kParted * (std::max(terms(box, a.n), kLeastTerms) + seen);
            if (height <= 0 || apart > 2 * want) return true;
            if (length(nearest - foot) > kOnBall * length(c - nearest)) return true;
            const std::lock_guard lock(mutex);
            inward[own] = true, rests[own] = false;
            move[own] = std::max(std::min(move[own], apart - want), -most_moved);
            return true;
        });
    // Moves that respect all touches, if none of them is above a limit.
    const std::vector<double> off_balls = move;
    const auto resolve = [&](double most) {
        bool changed = true, cut = false;
        move = off_balls;
        for (int round = 0; changed && round < kMostLayers; ++round) {
            changed = false;
            for (const Touch& t : touches) {
                if (t.above ? !rests[t.own] : t.out ? inward[t.own] : rests[t.own]) continue;
                const double sign = t.out ? 1 : -1;
                const double apart = t.apart + sign * (move[t.own] - t.turn * move[t.other]);
                if (apart >= t.want * (1 - 1e-6)) continue;
                const double all = move[t.own] + sign * (t.want - apart);
                const double by = std::clamp(all, -most, most);
                cut = cut || by != all;
                changed = changed || by != move[t.own];
                move[t.own] = by;
            }
        }
        return !cut;
    };
    if (!resolve(most_moved)) {
        if (further == 0) return false;
        resolve(kMostMoved);  // they cannot all be respected
    }
    for (const Touch& t : touches)
        if (!t.far || t.crosses || move[t.own] != 0 || move[t.other] != 0)
            crossing.insert(crossing.end(), {t.own, t.other});
    for (const uint32_t i : crossing) {
        if (column(i, kPrimOffset) == kTouches) continue;
        column(i, kPrimOffset) = kTouches;
        // Paths leave both sides of it by less than its plane would lie behind.
        const float behind =
            flat && !is_clear(i) && !in.sees_both_sides(sources[i].material) ? kPlaneSlack : 0;
        if (sources[i].group == kTriangleGroup)
            column(i, kPrimPlane) = -static_cast<float>(
                plane_at_origin(flat ? flats_[i] : triangle(in, sources[i].row)));
        plane_record(i)[3] = -column(i, kPrimPlane) + behind;
    }
    for (const uint32_t i : clear) {
        if (move[i] == 0) continue;
        slab_slack = static_cast<float>(most_moved / kOfSlack);
        move_plane(i, move[i]);
    }
    return true;
}

}  // namespace veriray
