// The scene on the host: takes world-space triangles, gives tables and a SceneView.
#pragma once

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "scene/view.h"

namespace veriray {

// Input in world units; arrays are row-major and belong to the caller.
struct SceneInput {
    const double* vertices;  // (vertex_count, 3)
    size_t vertex_count;
    const uint32_t* triangles;  // (triangle_count, 3), counter-clockwise seen from the front
    size_t triangle_count;
    const uint32_t* triangle_material;
    const int32_t* triangle_emission;  // -1: none
    const float* reflectance;          // (material_count, 3)
    const uint8_t* two_sided;
    size_t material_count;
    const float* emissions;  // (emission_count, 3)
    size_t emission_count;
    float environment[3];
    double to_world[16];
    double tan_half_x, tan_half_y, near_clip, far_clip, principal_x, principal_y;
    uint32_t width, height;
    std::string filter;
    double filter_parameter;
};

struct Double3 {
    double x, y, z;
    double operator[](int k) const { return k == 0 ? x : k == 1 ? y : z; }
};
inline Double3 operator+(Double3 a, Double3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Double3 operator-(Double3 a, Double3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Double3 operator*(Double3 a, double s) { return {a.x * s, a.y * s, a.z * s}; }
inline double dot(Double3 a, Double3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Double3 cross(Double3 a, Double3 b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double length(Double3 a) { return std::sqrt(dot(a, a)); }
inline Double3 normalised(Double3 a) { return a * (1.0 / length(a)); }

// A flat convex primitive with 3 or 4 corners in order, normalised units rounded to float32.
struct Flat {
    std::array<Double3, 4> v;
    uint32_t corners;
    uint32_t triangle;  // the first input triangle in it
    uint32_t material;
    int32_t emission;
    bool parallelogram;

    Double3 area_vector() const {
        const Double3 c = cross(v[1] - v[0], v[2] - v[0]);
        return corners == 3 ? c * 0.5 : (c + cross(v[2] - v[0], v[3] - v[0])) * 0.5;
    }
};

// Joins coplanar pairs that share an edge, a material and an emission into convex quadrilaterals.
std::vector<Flat> merge_coplanar(const std::vector<Flat>& triangles);
// Edge k (corner k to k + 1) of each primitive: true where it must be widened, because another
// primitive runs along it.
std::vector<std::array<bool, 4>> shared_edges(const std::vector<Flat>& flats);
void write_quad(const Flat& f, const std::array<bool, 4>& shared, float* out);
void write_polygon(const Flat& f, const std::array<bool, 4>& shared, float* out);

struct BuiltBvh {
    std::vector<BvhNode> nodes;
    std::vector<uint32_t> order;
};
// lo, hi: per primitive boxes, 3 floats each.
BuiltBvh build_bvh(const std::vector<float>& lo, const std::vector<float>& hi);

class HostScene {
   public:
    explicit HostScene(const SceneInput& in);
    HostScene(const HostScene&) = delete;
    HostScene& operator=(const HostScene&) = delete;

    SceneView view;        // pointers into the tables below
    double unit;           // world length of 1 normalised; a power of two
    Double3 centre;        // world
    uint32_t dropped = 0;  // triangles without area
    uint32_t width, height;
    std::vector<uint32_t> primitive_triangle;  // primitive -> first input triangle

    std::vector<float> primitives, light_pdf_area, surfaces, triangles, light_table, filter_edges;
    std::vector<uint32_t> surface_of, light_cdf;
    BuiltBvh bvh;

    size_t memory() const;

   private:
    void normalise(const SceneInput& in);
    std::vector<Flat> input_triangles(const SceneInput& in);
    void set_primitives(const SceneInput& in, const std::vector<Flat>& prims, bool tree);
    void set_lights(const SceneInput& in, const std::vector<Flat>& prims);
    void set_camera(const SceneInput& in);
    void set_filter(const SceneInput& in);
};

}  // namespace veriray
