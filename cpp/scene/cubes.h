// A grid of cubes around a scene, of which those are blocked that surfaces meet, and rays through
// it.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <vector>

#include "scene/scene.h"

namespace veriray {

// Of the largest component.
inline int main_axis(Double3 n) {
    const double x = std::abs(n.x), y = std::abs(n.y), z = std::abs(n.z);
    return x >= y && x >= z ? 0 : y >= z ? 1 : 2;
}

// A direction: along each axis, which way, and how far from cube to cube.
struct Way {
    std::array<int, 3> step;
    std::array<float, 3> each;

    explicit Way(Double3 d) {
        for (size_t c = 0; c < 3; ++c) {
            const double x = d[static_cast<int>(c)];
            step[c] = x < 0 ? -1 : 1;
            each[c] = static_cast<float>(std::min(std::abs(1 / x), 1e30));
        }
    }
};

class Cubes {
   public:
    static constexpr int kMost = 64;  // along the longest axis

    // A cube more than the box on all sides.
    explicit Cubes(const Box& box) {
        const Double3 size = box.high - box.low;
        edge_ = std::max({size.x, size.y, size.z}) / kMost;
        low_ = box.low - Double3{edge_, edge_, edge_};
        for (int k = 0; k < 3; ++k) n_[k] = static_cast<int>(size[k] / edge_) + 3;
        state_.assign(size_t(n_[0]) * size_t(n_[1]) * size_t(n_[2]), kClosed);
    }
    Double3 low() const { return low_; }
    double edge() const { return edge_; }
    int along(int k) const { return n_[k]; }
    bool blocked(int x, int y, int z) const { return state_[index(x, y, z)] == kBlocked; }
    bool open(int x, int y, int z) const { return state_[index(x, y, z)] == kOpen; }

    // Opens the cubes that are connected with the grid's border, once all is blocked that is.
    void open_outside() {
        std::vector<std::array<int, 3>> todo;
        const auto visit = [&](int x, int y, int z) {
            uint8_t& state = state_[index(x, y, z)];
            if (state != kClosed) return;
            state = kOpen;
            todo.push_back({x, y, z});
        };
        for (int z = 0; z < n_[2]; ++z)
            for (int y = 0; y < n_[1]; ++y) {
                const bool side = z == 0 || z == n_[2] - 1 || y == 0 || y == n_[1] - 1;
                for (int x = 0; x < n_[0]; x += side ? 1 : n_[0] - 1) visit(x, y, z);
            }
        while (!todo.empty()) {
            const auto [x, y, z] = todo.back();
            todo.pop_back();
            if (x > 0) visit(x - 1, y, z);
            if (x < n_[0] - 1) visit(x + 1, y, z);
            if (y > 0) visit(x, y - 1, z);
            if (y < n_[1] - 1) visit(x, y + 1, z);
            if (z > 0) visit(x, y, z - 1);
            if (z < n_[2] - 1) visit(x, y, z + 1);
        }
    }

    // M. Schwarz, H.-P. Seidel, "Fast Parallel Surface and Solid Voxelization on GPUs", 2010.
    void block_triangle(Double3 a, Double3 b, Double3 c) {
        const Double3 v[3] = {place(a), place(b), place(c)};
        int low[3], high[3];
        for (int k = 0; k < 3; ++k) {
            const auto [least, most] = std::minmax({v[0][k], v[1][k], v[2][k]});
            if (!(most >= 0 && least < n_[k])) return;
            low[k] = static_cast<int>(std::max(least, 0.));
            high[k] = static_cast<int>(std::min(most, n_[k] - 1.));
        }
        const Double3 n = cross(v[1] - v[0], v[2] - v[0]);
        double first = -dot(n, v[0]), last = first;  // of the cube's corners, above the plane
        for (int k = 0; k < 3; ++k) (n[k] > 0 ? last : first) += n[k];
        // Edges as seen along an axis: their normals and the cube's farthest corner before them.
        double across[3][3], along[3][3], before[3][3];
        for (int k = 0; k < 3; ++k)
            for (int e = 0; e < 3; ++e) {
                const int x = (k + 1) % 3, y = (k + 2) % 3;
                const Double3 way = v[(e + 1) % 3] - v[e];
                const double side = n[k] < 0 ? -1 : 1;
                across[k][e] = -way[y] * side, along[k][e] = way[x] * side;
                before[k][e] = std::max(across[k][e], 0.) + std::max(along[k][e], 0.) -
                               across[k][e] * v[e][x] - along[k][e] * v[e][y];
            }
        int at[3];
        const auto meets = [&] {
            const double height = n.x * at[0] + n.y * at[1] + n.z * at[2];
            bool in = height + first <= 0 && height + last >= 0;
            for (int k = 0; k < 3 && in; ++k)
                for (int e = 0; e < 3; ++e)
                    in &= across[k][e] * at[(k + 1) % 3] + along[k][e] * at[(k + 2) % 3] +
                              before[k][e] >=
                          0;
            return in;
        };
        // Along the normal's main axis, from where to where the plane may be.
        const int m = main_axis(n), u = (m + 1) % 3, w = (m + 2) % 3;
        for (at[w] = low[w]; at[w] <= high[w]; ++at[w])
            for (at[u] = low[u]; at[u] <= high[u]; ++at[u]) {
                const double rest = n[u] * at[u] + n[w] * at[w];
                const auto [from, to] =
                    std::minmax({(-last - rest) / n[m], (-first - rest) / n[m]});
                if (!(to >= low[m] - 1 && from <= high[m] + 1)) continue;
                const int begin = std::max(low[m], static_cast<int>(std::floor(from))),
                          end = std::min(high[m], static_cast<int>(std::ceil(to)));
                for (at[m] = begin; at[m] <= end; ++at[m])
                    if (meets()) block(at[0], at[1], at[2]);
            }
    }
    // Cubes whose middle is within half a cube of it.
    void block_sphere(Double3 centre, double radius) {
        const Double3 c = place(centre) - Double3{0.5, 0.5, 0.5};  // of middles
        const double most = radius / edge_ + 0.5, least = std::max(most - 1, 0.);
        const auto span = [](double middle, double half, int n, int& first, int& last) {
            first = static_cast<int>(std::clamp(std::ceil(middle - half), 0., double(n)));
            last = static_cast<int>(std::clamp(std::floor(middle + half) + 1, 0., double(n)));
        };
        int z, y, x, ends[3], skip[2];
        span(c.z, most, n_[2], z, ends[2]);
        for (; z < ends[2]; ++z) {
            const double flat = most * most - (z - c.z) * (z - c.z);
            span(c.y, std::sqrt(std::max(flat, 0.)), n_[1], y, ends[1]);
            for (; y < ends[1]; ++y) {
                const double rest = flat - (y - c.y) * (y - c.y);
                const double inner = rest + least * least - most * most;
                span(c.x, std::sqrt(std::max(rest, 0.)), n_[0], x, ends[0]);
                span(c.x, inner > 0 ? std::sqrt(inner) : -1., n_[0], skip[0], skip[1]);
                for (; x < ends[0]; ++x)
                    if (x < skip[0] || x >= skip[1]) block(x, y, z);
            }
        }
    }

    // Whether a ray from the place p in the cube k leaves the grid. J. Amanatides, A. Woo, "A Fast
    // Voxel Traversal Algorithm for Ray Tracing", 1987.
    bool leaves(const std::array<int, 3>& k, const std::array<float, 3>& p, const Way& way) const {
        int left[3];    // steps to the side where the ray leaves
        float next[3];  // distances to the next cubes
        for (size_t c = 0; c < 3; ++c) {
            left[c] = way.step[c] < 0 ? k[c] + 1 : n_[c] - k[c];
            next[c] = (way.step[c] < 0 ? p[c] : 1 - p[c]) * way.each[c];
        }
        const int stride[3] = {way.step[0], way.step[1] * n_[0], way.step[2] * n_[0] * n_[1]};
        const uint8_t* at = &state_[index(k[0], k[1], k[2])];
        for (;;) {  // without branches between the axes
            const int x = (next[0] <= next[1]) & (next[0] <= next[2]),
                      y = (x ^ 1) & (next[1] <= next[2]), z = (x | y) ^ 1;
            left[0] -= x, left[1] -= y, left[2] -= z;
            if ((left[0] == 0) | (left[1] == 0) | (left[2] == 0)) return true;
            at += (stride[0] & -x) + (stride[1] & -y) + (stride[2] & -z);
            if (*at == kBlocked) return false;
            next[0] += x ? way.each[0] : 0, next[1] += y ? way.each[1] : 0;
            next[2] += z ? way.each[2] : 0;
        }
    }

   private:
    Double3 place(Double3 p) const { return (p - low_) * (1 / edge_); }
    size_t index(int x, int y, int z) const {
        return (size_t(z) * size_t(n_[1]) + size_t(y)) * size_t(n_[0]) + size_t(x);
    }
    void block(int x, int y, int z) {
        std::atomic_ref(state_[index(x, y, z)]).store(kBlocked, std::memory_order_relaxed);
    }

    Double3 low_;
    double edge_;
    int n_[3];
    static constexpr uint8_t kClosed = 0, kOpen = 1, kBlocked = 2;
    std::vector<uint8_t> state_;  // closed: nothing leads there from outside
};

}  // namespace veriray
