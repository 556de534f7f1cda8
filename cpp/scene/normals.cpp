#include "scene/normals.h"

#include <atomic>

#include "scene/scene.h"
#include "scene/thread_pool.h"

namespace veriray {
namespace {

Double3 at(const double* rows, size_t i) { return {rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]}; }

// Divided by the length, without overflow; zeros stay.
Double3 unit_of(Double3 v) {
    const double largest = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
    const double by = largest > 0 ? largest : 1.0;
    const Double3 scaled{v.x / by, v.y / by, v.z / by};
    const double size = length(scaled), divisor = size > 0 ? size : 1.0;
    return {scaled.x / divisor, scaled.y / divisor, scaled.z / divisor};
}

Double3 facing_of(Double3 a, Double3 b, Double3 c) { return unit_of(cross(b - a, c - a)); }

// Between unit vectors: 2 atan(|a - b| / |a + b|), to about 1e-12.
double angle(Double3 a, Double3 b) {
    double x = std::min(length(a - b) / std::max(length(a + b), 1e-300), 1e12);
    for (int halved = 0; halved < 4; ++halved) x = x / (1.0 + std::sqrt(1.0 + x * x));
    const double square = x * x;
    double series = 0;
    for (int n = 11; n > 0; n -= 2) series = 1.0 / n - square * series;
    return 32.0 * x * series;
}

void check_corners(const MeshView& mesh) {
    std::atomic<bool> good{true};
    in_chunks(kAllThreads, 3 * mesh.triangle_count, [&](size_t first, size_t last) {
        bool all = true;
        for (size_t i = first; i < last; ++i) all = all & (mesh.triangles[i] < mesh.vertex_count);
        if (!all) good = false;
    });
    if (!good) throw std::invalid_argument("triangles: a corner is no vertex");
}

}  // namespace

void vertex_normals(const MeshView& mesh, double* out) {
    check_corners(mesh);
    // Each thread adds what belongs to the vertices of its own range, so the order is fixed.
    const uint32_t parts =
        mesh.triangle_count < 4096 ? 1u : std::max(1u, std::thread::hardware_concurrency());
    const auto part_of = [&](size_t part) { return mesh.vertex_count * part / parts; };
    parallel(parts, parts, {}, [&](uint32_t, uint64_t part) {
        const size_t first = part_of(part), last = part_of(part + 1);
        std::fill(out + 3 * first, out + 3 * last, 0.0);
        for (int k = 0; k < 3; ++k)
            for (size_t i = 0; i < mesh.triangle_count; ++i) {
                const uint32_t* corners = mesh.triangles + 3 * i;
                const size_t v = corners[k];
                if (v < first || v >= last) continue;
                const Double3 p[3] = {at(mesh.vertices, corners[0]), at(mesh.vertices, corners[1]),
                                      at(mesh.vertices, corners[2])};
                const Double3 facing = facing_of(p[0], p[1], p[2]);
                const Double3 before = unit_of(p[k] - p[(k + 2) % 3]);
                const double weight =
                    angle(unit_of(p[(k + 1) % 3] - p[k]), {-before.x, -before.y, -before.z});
                double* sum = out + 3 * v;
                sum[0] += facing.x * weight;
                sum[1] += facing.y * weight;
                sum[2] += facing.z * weight;
            }
        for (size_t v = first; v < last; ++v) {
            const Double3 n = unit_of(at(out, v));
            out[3 * v] = n.x, out[3 * v + 1] = n.y, out[3 * v + 2] = n.z;
        }
    });
}

Shading shading_of(const MeshView& mesh, const double* normals) {
    check_corners(mesh);
    std::atomic<bool> behind{false}, flat{true};
    in_chunks(kAllThreads, mesh.triangle_count, [&](size_t first, size_t last) {
        bool some = false, all = true;
        for (size_t i = first; i < last; ++i) {
            const uint32_t* corners = mesh.triangles + 3 * i;
            const Double3 facing =
                facing_of(at(mesh.vertices, corners[0]), at(mesh.vertices, corners[1]),
                          at(mesh.vertices, corners[2]));
            bool back = true, same = true;
            for (int k = 0; k < 3; ++k) {
                const double cosine = dot(at(normals, corners[k]), facing);
                back = back & (cosine < 0);
                same = same & (cosine > 1 - 1e-7);
            }
            const bool solid = facing.x != 0 || facing.y != 0 || facing.z != 0;
            some = some | back;
            all = all & (same | !solid);
        }
        if (some) behind = true;
        if (!all) flat = false;
    });
    return {behind, flat};
}

}  // namespace veriray
