// Shading normals of triangle meshes, with the bits of python/veriray/formats/mesh.py.
#pragma once

#include <cstddef>
#include <cstdint>

namespace veriray {

// A mesh that belongs to the caller; corners are rows of the vertices (three doubles each).
struct MeshView {
    const double* vertices;
    const uint32_t* triangles;
    size_t vertex_count, triangle_count;
};

// Normals of all vertices: the unit normals of the triangles around each, weighted by their angles
// there, added in the order of their corners, then of triangles; zero without any. Vertices are
// within [-1e100, 1e100]. Throws std::invalid_argument for a corner that is no vertex.
void vertex_normals(const MeshView& mesh, double* out);

// Whether the normals at all corners of some triangle point to its back; and whether all normals
// are those of the triangles with an area to 5e-4 radian.
struct Shading {
    bool behind, flat;
};
Shading shading_of(const MeshView& mesh, const double* normals);

}  // namespace veriray
