// Bodies that touch: what can be told apart only by rounding is parted by more than that.
//
// A surface that lets light through (glass, null, thin, masked, a medium's boundary) and another in
// the same plane, a box on a floor, are met in an order that rounding would decide; and a path that
// leaves one by its offset would begin beyond the other. The planes of the former are moved by
// kParted of the terms of n.p where they overlap, twice what paths leave them by: into the body
// where the two look against each other, else away from the other. A surface keeps its edges, so
// that bodies stay closed.
#include <algorithm>
#include <functional>
#include <mutex>
#include <numeric>

#include "scene/box_pairs.h"

namespace veriray {
namespace {

// Of the terms of n.p.
constexpr double kParted = 0x1p-20;
static_assert(kParted == 2 * static_cast<double>(kLocalOffset));
// Planes that are nearer to each other count as one.
constexpr double kOnePlane = 0x1p-19;
// Pairs of primitives that are looked at; beyond it, transparent ones and the largest of all.
constexpr size_t kMostPairs = size_t{1} << 26;

struct Face {
    Box box;
    Double3 n;
    double w;
};

// What to look for overlaps in.
Box widened(const Box& b) {
    const auto by = [&](int k) {
        return 2 * kOnePlane * std::max({std::abs(b.low[k]), std::abs(b.high[k]), 0x1p-20});
    };
    const Double3 margin{by(0), by(1), by(2)};
    return {b.low - margin, b.high + margin};
}

bool overlap(const Box& a, const Box& b, Box& out) {
    double low[3], high[3];
    for (int k = 0; k < 3; ++k) {
        const double reach = std::max({std::abs(a.low[k]), std::abs(a.high[k]), 0x1p-20});
        low[k] = std::max(a.low[k], b.low[k]), high[k] = std::min(a.high[k], b.high[k]);
        if (low[k] > high[k] + kOnePlane * reach) return false;
        if (low[k] > high[k]) std::swap(low[k], high[k]);
    }
    out = {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
    return true;
}

bool clear_material(const SceneInput& in, uint32_t m) {
    const auto kind = static_cast<MaterialKind>(in.material_kind.data[m]);
    return kind == MaterialKind::kDielectric || kind == MaterialKind::kThinDielectric ||
           kind == MaterialKind::kNull || in.opacity.data[m] < 1;
}

// Of the middle of a box over the plane of a face.
double over(const Box& b, const Face& f) { return dot(f.n, (b.low + b.high) * 0.5) + f.w; }

// Largest |g.p + c| over a box, and sum of |g_k p_k|.
double largest(const Box& b, Double3 g, double c) {
    double low = c, high = c;
    for (int k = 0; k < 3; ++k) {
        low += std::min(g[k] * b.low[k], g[k] * b.high[k]);
        high += std::max(g[k] * b.low[k], g[k] * b.high[k]);
    }
    return std::max(std::abs(low), std::abs(high));
}
double terms(const Box& b, Double3 n) {
    double sum = 0;
    for (int k = 0; k < 3; ++k)
        sum += std::abs(n[k]) * std::max(std::abs(b.low[k]), std::abs(b.high[k]));
    return sum;
}

}  // namespace

bool HostScene::lets_through(const SceneInput& in, ShapeGroup group, uint32_t row) const {
    return clear_material(in, in.material[group].data[row]) || in.boundary[group].data[row] >= 0;
}

// The faces of largest extent, so many of the first `planar` primitives.
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
    // Of those as large as the last one that is taken, the first.
    auto equal = std::count(sorted.begin(), last + 1, *last);
    for (uint32_t i = 0; i < planar; ++i)
        if (extent[i] > *last || (extent[i] == *last && equal-- > 0)) faces.push_back(i);
    return faces;
}

void HostScene::part_touching(const SceneInput& in) {
    const size_t planar = view.first_sphere;
    bool any = in.boundaries.count > 0;
    for (uint32_t m = 0; m < in.material_kind.count; ++m) any |= clear_material(in, m);
    if (!any) return;
    std::vector<uint32_t> clear;  // in any order
    std::mutex mutex;
    in_chunks(kAllThreads, planar, [&](size_t first, size_t last) {
        std::vector<uint32_t> found;
        for (size_t i = first; i < last; ++i)
            if (lets_through(in, sources[i].group, sources[i].row))
                found.push_back(static_cast<uint32_t>(i));
        const std::lock_guard lock(mutex);
        clear.insert(clear.end(), found.begin(), found.end());
    });
    if (clear.empty()) return;
    const std::vector<uint32_t> others =
        largest_faces(in, planar, std::min(planar, kMostPairs / clear.size()));
    const auto plane = [&](uint32_t i) {
        return &records[static_cast<size_t>(i) * kRecordFloats] +
               (sources[i].group == kTriangleGroup ? kRecordPlane : 0);
    };
    const auto face = [&](uint32_t i) {
        const float* p = plane(i);
        return Face{box_around(in, i), {p[0], p[1], p[2]}, p[3]};
    };
    std::vector<double> move(clear.size(), 0.0);
    std::vector<bool> touches(planar, false);
    const auto look = [&](size_t i, size_t k) {
        const uint32_t own = clear[i], other = others[k];
        if (own == other) return true;
        const Face a = face(own), b = face(other);
        Box common;
        if (!overlap(a.box, b.box, common)) return true;
        const double turn = dot(a.n, b.n) < 0 ? -1 : 1;
        const double size = std::max(terms(common, a.n), terms(common, b.n));
        if (largest(common, a.n - b.n * turn, a.w - b.w * turn) > kOnePlane * size) return true;
        const PrimitiveSource &from = sources[own], &to = sources[other];
        const bool other_clear = lets_through(in, to.group, to.row);
        if (turn > 0 && (from.same_surface(to) || (other_clear && other > own))) return true;
        // Two that look the same way keep their order; of two in one plane a clear one lies on an
        // opaque one, and the later of two clear ones within the earlier. Into the body counts more
        // than off another surface.
        const double above = over(common, b) - turn * over(common, a);
        const bool out = turn > 0 && (above > 0 || (above == 0 && !other_clear));
        const double away = (out ? kParted : -kParted) * size;
        const std::lock_guard lock(mutex);
        double& by = move[i];
        by = away < 0 || by < 0 ? std::min(by, away) : std::max(by, away);
        touches[own] = touches[other] = true;
        return true;
    };
    box_pairs(
        clear.size(), [&](size_t i) { return widened(box_around(in, clear[i])); }, others.size(),
        [&](size_t k) { return box_around(in, others[k]); }, look);
    for (size_t i = 0; i < planar; ++i)
        if (touches[i])
            primitives[i * view.primitive_row + kPrimOffset * view.primitive_column] = -1.f;
    for (size_t i = 0; i < clear.size(); ++i) {
        if (move[i] == 0) continue;
        float& w = plane(clear[i])[3];
        w = static_cast<float>(static_cast<double>(w) - move[i]);
        primitives[clear[i] * view.primitive_row + kPrimPlane * view.primitive_column] = -w;
    }
}

}  // namespace veriray
