// Binned surface-area-heuristic builder. I. Wald, "On fast Construction of SAH-based Bounding
// Volume Hierarchies", 2007.
#include <algorithm>
#include <limits>
#include <numeric>

#include "scene/scene.h"

namespace veriray {
namespace {

constexpr int kBins = 16;
constexpr uint32_t kMedianDepth = 32;  // below, halves: the depth stays under kBvhStack

struct Box {
    float lo[3] = {INFINITY, INFINITY, INFINITY}, hi[3] = {-INFINITY, -INFINITY, -INFINITY};
    void grow(const float* l, const float* h) {
        for (int k = 0; k < 3; ++k) lo[k] = std::min(lo[k], l[k]), hi[k] = std::max(hi[k], h[k]);
    }
    double area() const {
        const double x = hi[0] - lo[0], y = hi[1] - lo[1], z = hi[2] - lo[2];
        return x < 0 ? 0 : x * y + y * z + z * x;
    }
};

struct Builder {
    const std::vector<float>&lo, &hi;
    BuiltBvh out;

    float centre(uint32_t p, int axis) const {
        return 0.5f * (lo[3 * p + axis] + hi[3 * p + axis]);
    }

    Box bounds(uint32_t first, uint32_t last) const {
        Box b;
        for (uint32_t i = first; i < last; ++i)
            b.grow(&lo[3 * out.order[i]], &hi[3 * out.order[i]]);
        return b;
    }

    // Partition point of [first, last), more than kLeafTriangles long.
    uint32_t split(uint32_t first, uint32_t last, uint32_t depth) {
        Box c;
        for (uint32_t i = first; i < last; ++i) {
            const uint32_t p = out.order[i];
            const float m[3] = {centre(p, 0), centre(p, 1), centre(p, 2)};
            c.grow(m, m);
        }
        int axis = 0;
        for (int k = 1; k < 3; ++k)
            if (c.hi[k] - c.lo[k] > c.hi[axis] - c.lo[axis]) axis = k;
        const float width = c.hi[axis] - c.lo[axis];
        const auto begin = out.order.begin();
        if (depth < kMedianDepth && width > 0) {
            const auto bin = [&](uint32_t p) {
                return std::min(kBins - 1,
                                static_cast<int>((centre(p, axis) - c.lo[axis]) / width * kBins));
            };
            Box box[kBins];
            uint32_t n[kBins] = {};
            for (uint32_t i = first; i < last; ++i) {
                const uint32_t p = out.order[i];
                box[bin(p)].grow(&lo[3 * p], &hi[3 * p]);
                ++n[bin(p)];
            }
            double right[kBins];
            Box acc;
            uint32_t count = 0;
            for (int k = kBins - 1; k > 0; --k) {
                acc.grow(box[k].lo, box[k].hi);
                right[k] = acc.area() * (count += n[k]);
            }
            acc = Box(), count = 0;
            int best = 0;
            double cost = std::numeric_limits<double>::infinity();
            for (int k = 1; k < kBins; ++k) {
                acc.grow(box[k - 1].lo, box[k - 1].hi);
                count += n[k - 1];
                const double here = acc.area() * count + right[k];
                if (count > 0 && count < last - first && here < cost) cost = here, best = k;
            }
            if (best > 0) {
                const auto mid = std::partition(begin + first, begin + last,
                                                [&](uint32_t p) { return bin(p) < best; });
                return static_cast<uint32_t>(mid - begin);
            }
        }
        const uint32_t mid = first + (last - first) / 2;
        std::nth_element(begin + first, begin + mid, begin + last, [&](uint32_t a, uint32_t b) {
            const float x = centre(a, axis), y = centre(b, axis);
            return x < y || (x == y && a < b);
        });
        return mid;
    }

    uint32_t build(uint32_t first, uint32_t last, uint32_t depth) {
        if (last - first <= kLeafTriangles) return kLeafFlag | first << 2 | (last - first - 1);
        const uint32_t mid = split(first, last, depth);
        const uint32_t index = static_cast<uint32_t>(out.nodes.size());
        out.nodes.emplace_back();
        const uint32_t range[3] = {first, mid, last};
        for (int k = 0; k < 2; ++k) {
            const Box b = bounds(range[k], range[k + 1]);
            for (int a = 0; a < 3; ++a) {
                out.nodes[index].lo[k][a] = b.lo[a] - kBoxPad;
                out.nodes[index].hi[k][a] = b.hi[a] + kBoxPad;
            }
            const uint32_t child = build(range[k], range[k + 1], depth + 1);
            out.nodes[index].child[k] = child;
        }
        return index;
    }
};

}  // namespace

BuiltBvh build_bvh(const std::vector<float>& lo, const std::vector<float>& hi) {
    const uint32_t n = static_cast<uint32_t>(lo.size() / 3);
    if (n >= 1u << 29) throw std::invalid_argument("more than 2^29 - 1 triangles");
    Builder b{lo, hi, {}};
    b.out.order.resize(n);
    std::iota(b.out.order.begin(), b.out.order.end(), 0u);
    if (n <= kLeafTriangles) {  // the walk starts at a node: wrap a lone leaf
        BvhNode root;
        const Box all = b.bounds(0, n);
        for (int k = 0; k < 2; ++k)
            for (int a = 0; a < 3; ++a) {
                root.lo[k][a] = k ? INFINITY : all.lo[a] - kBoxPad;
                root.hi[k][a] = k ? INFINITY : all.hi[a] + kBoxPad;
            }
        root.child[0] = root.child[1] = kLeafFlag | (n - 1);
        b.out.nodes.push_back(root);
        return b.out;
    }
    b.build(0, n, 0);
    return b.out;
}

}  // namespace veriray
