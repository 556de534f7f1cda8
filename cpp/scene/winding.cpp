// Finds triangles to turn round so that their vertex normals point out of the front.
#include <algorithm>
#include <numeric>
#include <vector>

#include "scene/edge_hash.h"
#include "scene/thread_pool.h"

namespace veriray {

// A closed mesh with consistent winding is turned as a whole or not at all, by the majority of its
// area: the normals of a fold can point through a triangle, whose inside stays inside. In other
// meshes each triangle is turned by itself.
void HostScene::orient(const SceneInput& in) {
    if (!has_normals_) return;
    const size_t count = in.triangles.count;
    // Twice the area; less if the normals are oblique, negative if they point back; 0: flat.
    std::vector<double> outward(count, 0.0);
    in_chunks(kAllThreads, count, [&](size_t first, size_t last) {
        Double3 n[3];
        for (size_t i = first; i < last; ++i)
            if (vertex_normals(in, i, n))
                outward[i] = dot(triangle(in, i).area_vector(), n[0] + n[1] + n[2]);
    });
    const auto back = [](double x) { return x < 0; };
    const auto front = [](double x) { return x > 0; };
    if (std::none_of(outward.begin(), outward.end(), back)) return;
    turned_.resize(count);
    std::transform(outward.begin(), outward.end(), turned_.begin(), back);
    if (std::none_of(outward.begin(), outward.end(), front)) return;

    // Vertices in one place count as one; a mesh is a component connected by them.
    const size_t vertices = in.vertices.count;
    std::vector<uint64_t> place(vertices);
    std::vector<uint32_t> order(vertices), root(vertices);
    for (size_t v = 0; v < vertices; ++v) place[v] = hashed(point(in, v));
    std::iota(order.begin(), order.end(), 0u);
    std::sort(order.begin(), order.end(),
              [&](uint32_t a, uint32_t b) { return place[a] < place[b]; });
    for (size_t k = 0; k < vertices; ++k)
        root[order[k]] =
            k && place[order[k]] == place[order[k - 1]] ? root[order[k - 1]] : order[k];
    const auto mesh = [&](uint32_t v) {
        while (root[v] != v) v = root[v] = root[root[v]];
        return v;
    };
    const auto corner = [&](size_t i, int k) { return in.triangles.data[3 * i + k]; };
    for (size_t i = 0; i < count; ++i)
        for (int k = 1; k < 3 && outward[i] != 0; ++k) {
            const uint32_t a = mesh(corner(i, 0)), b = mesh(corner(i, k));
            root[std::max(a, b)] = std::min(a, b);
        }
    std::vector<uint64_t> edges(vertices, 0);
    std::vector<double> most(vertices, 0.0);
    for (size_t i = 0; i < count; ++i) {
        if (outward[i] == 0) continue;
        const uint32_t m = mesh(corner(i, 0));
        most[m] += outward[i];
        for (int k = 0; k < 3; ++k)
            edges[m] += edge(place[corner(i, k)], place[corner(i, (k + 1) % 3)]);
    }
    for (size_t i = 0; i < count; ++i) {
        const uint32_t m = mesh(corner(i, 0));
        if (outward[i] != 0 && edges[m] == 0) turned_[i] = most[m] < 0;
    }
}

}  // namespace veriray
