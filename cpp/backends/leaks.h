// Rays from inside a closed mesh at its vertices and edges, and how many of them hit nothing.
#pragma once

#include "api/renderer.h"
#include "integrators/surface.h"

namespace veriray {

struct LeakTargets {
    const float* corners;  // triangles, 9 floats each, normalised
    uint32_t triangle_count;
    const float* origins;  // inside the mesh, normalised, 3 each
    uint32_t origin_count;
};

// Corners of the scene's flat triangles as they are traced.
inline std::vector<float> leak_corners(const HostScene& host) {
    std::vector<float> out;
    for (const Flat& f : host.flats())
        for (uint32_t k = 2; k < f.corners; ++k)
            for (const Double3& v : {f.v[0], f.v[k - 1], f.v[k]})
                for (int c = 0; c < 3; ++c) out.push_back(static_cast<float>(v[c]));
    for (size_t r = 0; r < host.records.size(); r += kRecordFloats)
        if (bit_cast<uint32_t>(host.records[r + kRecordKind]) == kTriangleRecord)
            out.insert(out.end(), &host.records[r], &host.records[r + 9]);
    if (out.empty()) throw std::invalid_argument("the scene has no triangles to aim at");
    return out;
}

inline std::vector<float> leak_origins(const HostScene& host, const double* origins, size_t n) {
    if (n == 0 || n >= 1u << 31) throw std::invalid_argument("count_leaks needs 1 to 2^31 origins");
    std::vector<float> out;
    for (size_t i = 0; i < 3 * n; ++i)
        out.push_back(
            static_cast<float>((origins[i] - host.centre[static_cast<int>(i % 3)]) / host.unit));
    return out;
}

// Ray i starts at origin i % origin_count. Even rounds of the origins aim at a corner of a triangle
// chosen by hashing i; odd ones at a point of an edge, half of them at its middle.
VR_HD Ray<Scalar> leak_ray(const LeakTargets& s, uint64_t i, bool& at_edge) {
    const float* from = s.origins + 3 * (i % s.origin_count);
    at_edge = (i / s.origin_count) & 1u;
    const Block<uint32_t> h = hash(
        Block<uint32_t>{static_cast<uint32_t>(i), static_cast<uint32_t>(i >> 32), 0x6c65616bu, 0});
    const float* triangle = s.corners + static_cast<uint64_t>(h.x % s.triangle_count) * 9;
    const float *a = triangle + 3 * (h.y % 3), *b = triangle + 3 * ((h.y + 1) % 3);
    const float u = !at_edge ? 0.f : (h.z & 1u) ? 0.5f : uniform(h.w);
    const Vec3<float> o{from[0], from[1], from[2]};
    const Vec3<float> p{fma(b[0] - a[0], u, a[0]), fma(b[1] - a[1], u, a[1]),
                        fma(b[2] - a[2], u, a[2])};
    const Vec3<float> d = p - o;
    return {o, d * (1.f / sqrt(dot(d, d)))};
}

// Whether ray i hits nothing.
VR_HD bool leaks(const SceneView& scene, const LeakTargets& s, uint64_t i, bool& at_edge) {
    const Ray<Scalar> ray = leak_ray(s, i, at_edge);
    return !(SurfaceReader<Scalar, kAllFeatures>::closest(scene, ray, nothing_met<Scalar>(),
                                                          kInfinity, true)
                 .t < kInfinity);
}

}  // namespace veriray
