// Bodies that touch: what can be told apart only by rounding is parted by more than that.
//
// A surface that lets light through (glass, null, thin, masked, a medium's boundary) and another in
// the same plane, a box on a floor, are met in an order that rounding would decide; and a path that
// leaves one by its offset would begin beyond the other. The planes of the former are moved by
// kParted of the terms of n.p where they overlap, twice what paths leave them by: into the body
// where the two look against each other, else away from the other. A surface keeps its edges, so
// that bodies stay closed.
#include <algorithm>
#include <numeric>

#include "scene/scene.h"

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
    uint32_t primitive;
    bool clear;
    Box box;
    Double3 n;
    double w;

    double extent() const {
        return std::max({box.high.x - box.low.x, box.high.y - box.low.y, box.high.z - box.low.z});
    }
};

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
    const uint32_t m = in.material[group].data[row];
    const auto kind = static_cast<MaterialKind>(in.material_kind.data[m]);
    return kind == MaterialKind::kDielectric || kind == MaterialKind::kThinDielectric ||
           kind == MaterialKind::kNull || in.opacity.data[m] < 1 ||
           in.boundary[group].data[row] >= 0;
}

void HostScene::part_touching(const SceneInput& in) {
    const size_t planar = view.first_sphere;
    std::vector<Face> faces(planar);
    size_t clear = 0;
    for (uint32_t i = 0; i < planar; ++i) {
        const PrimitiveSource& s = sources[i];
        const float* r = &records[static_cast<size_t>(i) * kRecordFloats];
        Face& f = faces[i];
        f.primitive = i;
        f.clear = lets_through(in, s.group, s.row);
        clear += f.clear;
        const float* plane = s.group == kTriangleGroup ? r + kRecordPlane : r;
        f.n = {plane[0], plane[1], plane[2]}, f.w = plane[3];
        f.box = box_around(in, i);
    }
    if (clear == 0) return;
    std::stable_sort(faces.begin(), faces.end(),
                     [](const Face& a, const Face& b) { return a.extent() > b.extent(); });
    const size_t others = std::min(planar, kMostPairs / clear);
    std::vector<double> move(planar, 0.0);
    std::vector<bool> touches(planar, false);
    for (const Face& a : faces) {
        if (!a.clear) continue;
        const PrimitiveSource& own = sources[a.primitive];
        for (size_t k = 0; k < others; ++k) {
            const Face& b = faces[k];
            Box common;
            if (b.primitive == a.primitive || !overlap(a.box, b.box, common)) continue;
            const double turn = dot(a.n, b.n) < 0 ? -1 : 1;
            const double size = std::max(terms(common, a.n), terms(common, b.n));
            if (largest(common, a.n - b.n * turn, a.w - b.w * turn) > kOnePlane * size) continue;
            if (turn > 0 &&
                (own.same_surface(sources[b.primitive]) || (b.clear && b.primitive > a.primitive)))
                continue;
            // Two that look the same way keep their order; of two in one plane a clear one lies on
            // an opaque one, and the later of two clear ones within the earlier. Into the body
            // counts more than off another surface.
            double& by = move[a.primitive];
            const double above = over(common, b) - turn * over(common, a);
            const bool out = turn > 0 && (above > 0 || (above == 0 && !b.clear));
            const double away = (out ? kParted : -kParted) * size;
            by = away < 0 || by < 0 ? std::min(by, away) : std::max(by, away);
            touches[a.primitive] = touches[b.primitive] = true;
        }
    }
    for (const Face& f : faces) {
        const size_t row = static_cast<size_t>(f.primitive) * view.primitive_row;
        if (touches[f.primitive]) primitives[row + kPrimOffset * view.primitive_column] = -1.f;
        if (move[f.primitive] == 0) continue;
        const float w = static_cast<float>(f.w - move[f.primitive]);
        primitives[row + kPrimPlane * view.primitive_column] = -w;
        records[static_cast<size_t>(f.primitive) * kRecordFloats +
                (sources[f.primitive].group == kTriangleGroup ? kRecordPlane : 0) + 3] = w;
    }
}

}  // namespace veriray
