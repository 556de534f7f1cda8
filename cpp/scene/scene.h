// The scene on the host: converts world-space arrays to tables and a SceneView.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "scene/bvh_build.h"
#include "scene/features.h"
#include "scene/table.h"
#include "scene/view.h"

namespace veriray {

// Rows of an array that belongs to the caller.
template <class T>
struct Rows {
    const T* data = nullptr;
    size_t count = 0;
};

template <class T>
bool same_rows(const Rows<T>& a, const Rows<T>& b) {
    return a.data == b.data && a.count == b.count;
}

// Groups of primitives.
enum ShapeGroup : uint32_t { kTriangleGroup, kSphereGroup, kDiskGroup };

inline constexpr uint32_t kPatchColumns = 11;  // of SceneInput::meter_patches

// Input in world units: the arrays of schema/columns.def, row-major; camera and film.
struct SceneInput {
#define VR_COLUMN(table, name, type, ...) Rows<type> name;
#define VR_INDEX VR_COLUMN
#define VR_KIND VR_COLUMN
#define VR_TABLE(table, first) \
    size_t table##_rows() const { return first.count; }
#include "schema/columns.def"
    size_t scene_rows() const { return 1; }

    double to_world[16];
    bool parallel;  // the tangents are then half the film's extents in world units
    double tan_half_x, tan_half_y, near_clip, far_clip, principal_x, principal_y;
    double aperture_radius, focus_distance;
    bool hides_light;  // lamps and sky are not there for camera rays
    int32_t camera_medium;
    // What the rays of a camera begin at, or go to; none: it is another camera. Columns: PatchKind,
    // side of the front (1 or -1), point, two axes; of spheres the first begins with the radius.
    Rows<double> meter_patches;
    bool meter_distant;
    uint32_t width, height;
    std::string filter;
    double filter_parameters[2];

    // Columns of a group; -1: none.
    const Rows<uint32_t>& material(ShapeGroup g) const {
        return pick(g, triangle_material, sphere_material, disk_material);
    }
    const Rows<int32_t>& emission(ShapeGroup g) const {
        return pick(g, triangle_emission, sphere_emission, disk_emission);
    }
    const Rows<int32_t>& boundary(ShapeGroup g) const {
        return pick(g, triangle_boundary, sphere_boundary, disk_boundary);
    }
    // Whether fits(material) holds of a material or of another one of its blend.
    template <class Fits>
    bool either(uint32_t material, Fits fits) const {
        const int32_t other = blend_material.data[material];
        return fits(material) || (other >= 0 && either(static_cast<uint32_t>(other), fits));
    }
    bool sees_both_sides(uint32_t material) const {
        return either(material, [&](uint32_t m) { return two_sided.data[m] != 0; });
    }
    // Of a light that no ray meets: else it is far away.
    bool light_has_place(size_t q) const;
    size_t primitives() const { return triangles.count + spheres.count + disks.count; }

   private:
    template <class T>
    static const T& pick(ShapeGroup g, const T& triangles, const T& spheres, const T& disks) {
        return g == kTriangleGroup ? triangles : g == kSphereGroup ? spheres : disks;
    }
};

// The largest number of primitives in a small scene, whose form is made anew for each camera.
constexpr size_t kMostSmall = 1024;

constexpr uint64_t kMostSkyTexels = uint64_t{1} << 27, kMostNumbers = 0x7ffffe00u;
constexpr uint32_t kMostNested = 8;  // textures around another

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
inline Double3 row3(const Rows<double>& rows, size_t i) {
    return {rows.data[3 * i], rows.data[3 * i + 1], rows.data[3 * i + 2]};
}

// A flat convex primitive with 3 or 4 corners in order, normalised units rounded to float32.
using Polygon = std::vector<Double3>;  // convex
// The part of a that b, of the same plane, covers; n: the plane's normal.
Polygon common_part(const Polygon& a, const Polygon& b, Double3 n);

struct Flat {
    std::array<Double3, 4> v;
    uint32_t corners;
    uint32_t triangle;  // the first input triangle in it
    uint32_t material;
    int32_t emission, boundary;
    bool parallelogram, swapped;

    Double3 area_vector() const {
        const Double3 c = cross(v[1] - v[0], v[2] - v[0]);
        return corners == 3 ? c * 0.5 : (c + cross(v[2] - v[0], v[3] - v[0])) * 0.5;
    }
};

struct Box {
    Double3 low, high;
};
Box box_of(const Flat& f);
inline Box around(const Box& a, const Box& b) {
    const auto low = [&](int k) { return std::min(a.low[k], b.low[k]); };
    const auto high = [&](int k) { return std::max(a.high[k], b.high[k]); };
    return {{low(0), low(1), low(2)}, {high(0), high(1), high(2)}};
}
// n.p of the box's corner that lies farthest along n.
inline double reach(const Box& box, Double3 n) {
    double sum = 0;
    for (int k = 0; k < 3; ++k) sum += std::max(n[k] * box.low[k], n[k] * box.high[k]);
    return sum;
}
// Largest |n.x p.x| + |n.y p.y| + |n.z p.z| over a box.
double terms(const Box& b, Double3 n);
// The squared distance between two boxes.
double squared_gap(const Box& a, const Box& b);
// How far an ellipse with half axes a and b reaches from its centre: along a unit vector, and along
// the coordinate axes.
double ellipse_reach(Double3 a, Double3 b, Double3 n);
Double3 ellipse_reach(Double3 a, Double3 b);

// The union of two coplanar triangles with a common edge, if it is convex or, for lights, a
// parallelogram. From its first corner, the edges go to the second triangle's own corner and to the
// first's.
bool join_coplanar(const Flat& a, const Flat& b, Flat& out);
// Joins coplanar pairs that share an edge, material, emission and media into convex quadrilaterals.
// matches: whether two of one material may be joined.
std::vector<Flat> merge_coplanar(const std::vector<Flat>& triangles,
                                 const std::function<bool(const Flat&, const Flat&)>& matches);
// For edge k (corner k to k + 1) of each primitive: whether the primitive must be widened there,
// because another one runs along it.
std::vector<std::array<bool, 4>> shared_edges(const std::vector<Flat>& flats);
// Whether something lies behind a widened face: then its edge is convex, and its rim sticks out.
bool rims_stick_out(const std::vector<Flat>& flats, const std::vector<std::array<bool, 4>>& shared);
void write_plane(const Flat& f, float* out);
// w of n.p + w before n is rounded: near the origin, neighbours then agree at their edge.
double plane_at_origin(const Flat& f);
// Radians between neighbouring pixels; of a parallel camera, their distance.
double pixel_step(const SceneInput& in);
// The depth before which a narrow view shows nothing; infinity if it is empty, 0 for other views.
double narrow_depth(const SceneInput& in, Double3 eye);
// How far before that depth rays of the view start, in a scene of this unit.
double narrow_start(const SceneInput& in, Double3 eye, double depth, double unit);
// behind: how far the record's plane lies behind the face. rim: the face's own edges.
void write_quad(const Flat& f, const std::array<bool, 4>& shared, float behind, float* out,
                std::array<float, 4>& rim);
// Writes the short record of a quad across or along an axis. Returns the way of its run; kAnyWay if
// it has no short record.
uint32_t write_short(const float* quad, float* out);
void write_polygon(const Flat& f, const std::array<bool, 4>& shared, float behind, float* out,
                   std::array<float, 4>& rim);

// The source of a primitive: row `row` of group `group`; -1 for no emission or no change of medium.
struct PrimitiveSource {
    ShapeGroup group;
    uint32_t row;
    uint32_t material;
    int32_t emission, boundary;

    bool same_surface(const PrimitiveSource& b) const {
        return material == b.material && emission == b.emission && boundary == b.boundary;
    }
};

// Material, emission and boundary.
using SurfaceKey = std::tuple<uint32_t, int32_t, int32_t>;

// An area light: one primitive, or two triangles that are the halves of a rectangle. rectangle: to
// be sampled by solid angle.
struct AreaLight {
    uint32_t primitive, other;
    bool rectangle;
    double area;
};

// Of a medium: that of rays in it which meet nothing; no light sample arrives.
struct MediumWalls {
    uint32_t beyond = 0;
    bool shut = false;
};

class LightTexture;
class SceneBounds;
struct SkyImage;
struct SkyPatches;
struct SkyOpenings;

// Where lengths are measured from, and their unit (frame.cpp).
struct Frame {
    Double3 centre, eye;  // world: the origin; the camera
    double unit;          // world length of 1 normalised; a power of two
    double before;        // camera rays start this far before the origin; 0: at the camera
    Box extent;           // world: around what rays meet; low > high where there is nothing
};

// Copies share their tables.
class HostScene : public Frame {
   public:
    explicit HostScene(const SceneInput& in);

    // Makes of the form of `was` that of `in`, with the bits of one made anew, and keeps all tables
    // that are the same (change.cpp). False if it must be made anew: then this object is of no use
    // any more. rough: keeps the frame where the camera is within its unit, so that bits may
    // differ.
    bool change(const SceneInput& was, const SceneInput& in, bool rough);

    SceneView view;                 // pointers into the tables below; bvh is the back end's
    float slab_slack = kSlabSlack;  // of a scene with a tree
    uint32_t dropped = 0;           // triangles without area
    uint32_t width, height;
    Table<PrimitiveSource> sources;  // by primitive
    Table<uint32_t> input_index;     // by primitive: triangle, T + sphere, T + S + disk

    Table<float> primitives, smooth, light_chance, light_row, surfaces, media, light_table,
        light_tree, filter_edges, uv, tangents, textures, sky_texels, sky_ends, sky_sines,
        sky_places, sky_rows, grids, cells, lobes, phase_values, phase_drawn, phase_ends,
        meter_patches;
    Table<uint32_t> surface_of, texels, sky_guides, phase_guides, meter_guides;
    // Of a scene with a tree, which the back end builds; see TreeInput.
    Table<float> records, round_boxes;

    TreeInput tree_input() const {
        const uint32_t others = static_cast<uint32_t>(round_boxes.size() / 6);
        return {records.data(), round_boxes.data(), view.primitive_count - others,
                view.primitive_count};
    }
    // The rows of `uv`, also of a scene without textures. There the two triangles of a face that
    // was merged have the map of the first.
    std::vector<float> texture_maps(const SceneInput& in) const;
    size_t memory() const;
    const std::vector<Flat>& flats() const { return flats_; }

   private:
    // Stages of making the tables, in order.
    enum Stage : uint32_t { kSurfaceStage, kTextureStage, kMediumStage, kLightStage, kStages };
    void run(Stage stage, const SceneInput& in);
    Frame frame_of(const SceneInput& in) const;
    Double3 point(const SceneInput& in, size_t vertex) const;
    bool vertex_normals(const SceneInput& in, size_t i, Double3 n[3]) const;
    void orient(const SceneInput& in);
    Flat triangle(const SceneInput& in, size_t i) const;
    double smallest_beside(const SceneInput& in, const std::vector<Flat>& flats, int radii) const;
    double nearest_point(const SceneInput& in, const std::vector<Flat>& flats) const;
    bool dense_beside(const SceneInput& in, const std::vector<Flat>& flats) const;
    bool set_flat(const SceneInput& in);
    void set_tree(const SceneInput& in);
    bool lets_through(const SceneInput& in, ShapeGroup group, uint32_t row) const;
    std::vector<uint32_t> largest_faces(const SceneInput& in, size_t planar, size_t count) const;
    void part_touching(const SceneInput& in);
    bool part_faces(const SceneInput& in, double most_moved);
    void part_concentric(const SceneInput& in);
    float* plane_record(uint32_t primitive);
    void move_plane(uint32_t primitive, double by);
    void put_triangle(const SceneInput& in, size_t primitive, uint32_t row);
    void put_triangles(const SceneInput& in, size_t count, const uint32_t* rows);
    void put_kind(size_t primitive, uint32_t kind);
    void allocate_primitives(size_t count, uint32_t row);
    // A number of a primitive's row.
    size_t place_of(size_t primitive, uint32_t column) const {
        return primitive * view.primitive_row + size_t{column} * view.primitive_column;
    }
    float column(size_t i, uint32_t c) const { return primitives[place_of(i, c)]; }
    float& column(size_t i, uint32_t c) { return primitives[place_of(i, c)]; }
    void put_plane(size_t primitive, const Flat& f, const float* plane, float least);
    void put_disk(const SceneInput& in, size_t primitive, uint32_t row, float* record);
    void put_sphere(const SceneInput& in, size_t primitive, uint32_t row, float* record);
    Box round_box(const SceneInput& in, ShapeGroup group, uint32_t row) const;
    Box box_around(const SceneInput& in, size_t primitive) const;
    void put_smooth(const SceneInput& in, size_t primitive, const Flat& f);
    void put_uv(const SceneInput& in, size_t primitive, float* out) const;
    std::array<Double3, 3> corner_uv(const SceneInput& in, const Flat& f) const;
    bool same_texture_map(const SceneInput& in, const Flat& a, const Flat& b) const;
    void set_textures(const SceneInput& in);
    std::array<double, 12> to_cube(const double* m) const;
    void set_grids(const SceneInput& in);
    void set_phases(const SceneInput& in);
    void put_attribute(const SceneInput& in, size_t t, size_t primitive, uint32_t* out) const;
    void set_attributes(const SceneInput& in);
    void put_tangents(const SceneInput& in, size_t primitive);
    void put_source(const SceneInput& in, size_t primitive, ShapeGroup group, uint32_t row);
    void list_surfaces(const SceneInput& in);
    void set_surfaces(const SceneInput& in);
    void set_media(const SceneInput& in);
    std::vector<MediumWalls> media_walls(const SceneInput& in) const;
    void set_lights(const SceneInput& in);
    Flat light_shape(const SceneInput& in, uint32_t primitive) const {
        return flats_.empty() ? triangle(in, sources[primitive].row) : flats_[primitive];
    }
    bool lights_closely(const SceneInput& in, const Flat& light) const;
    double area_of(const SceneInput& in, size_t primitive) const;
    std::vector<AreaLight> area_lights(const SceneInput& in) const;
    std::vector<Double3> outline(const SceneInput& in, const AreaLight& flat) const;
    bool sides_differ(const SceneInput& in, const PrimitiveSource& a,
                      const PrimitiveSource& b) const;
    bool back_to_back(const SceneInput& in, uint32_t a, uint32_t b) const;
    void part_backs(const SceneInput& in);
    void part_twins(const SceneInput& in);
    bool ends_before(const SceneInput& in, const AreaLight& light, Double3 n, double gap,
                     const Box& pair) const;
    std::vector<uint8_t> covered(const SceneInput& in, const std::vector<AreaLight>& lights) const;
    std::vector<AreaLight> take_covered(const SceneInput& in, std::vector<AreaLight>& lights);
    Flat shape_of(const SceneInput& in, const AreaLight& light) const;
    double receiver_distance(const SceneInput& in, size_t primitive, Double3 p) const;
    float brightest_light(const SceneInput& in, const std::vector<AreaLight>& lamps,
                          const std::vector<uint32_t>& lights) const;
    float brightest_receiver(const SceneInput& in, const std::vector<uint32_t>& lights,
                             float least) const;
    LightSource light_source(const SceneInput& in, const AreaLight& light) const;
    LightSource light_source(const SceneInput& in, uint32_t q) const;
    LightSource sky_source(const SceneInput& in);
    double set_sky_map(const SceneInput& in, const SkyImage& image);
    void set_sky_guide(const SkyPatches& patches, const SkyOpenings& openings,
                       const std::vector<double>& lines);
    const LightTexture& light_texture(const SceneInput& in, int32_t texture) const;
    float most_of_texture(const SceneInput& in, int32_t texture) const;
    double most_intense(const SceneInput& in, size_t q) const;
    double mean_of_texture(const SceneInput& in, const AreaLight& light, int32_t texture) const;
    float lamp_offset(const SceneInput& in, const AreaLight& light) const;
    void place_lamp(const SceneInput& in, const AreaLight& light, LightSource& s) const;
    void put_light(const LightSource& s, float* row, size_t stride);
    void set_first_occluder();
    void set_camera(const SceneInput& in);
    void set_meter(const SceneInput& in);
    template <class Density>
    double share_filter(FilterForm form, Density density, double reach);
    void set_filter(const SceneInput& in);
    void make_filter(const SceneInput& in);
    template <class Density>
    void tabulate_filter(Density density, double reach, double scale);

    std::vector<Flat> flats_;               // of a scene without a tree
    std::vector<uint8_t> covered_;          // by lamp, once it is known: whether it is not sampled
    bool has_normals_ = false;              // some that are not zero
    FeatureMask before_[kStages + 1] = {};  // the features before each stage, and after the last
    std::shared_ptr<const SceneBounds> bounds_;                                // of a large scene
    mutable std::map<int32_t, std::shared_ptr<LightTexture>> light_textures_;  // while it is built
    std::shared_ptr<const SkyOpenings> openings_;  // once they are known
    Table<SurfaceKey> surface_keys_;               // by surface
    Table<uint8_t> turned_;  // triangles turned so that their normals point out of the front
};

// Raises std::invalid_argument for what SceneInput's arrays must not hold. known: an input that has
// passed; null: none.
void check_input(const SceneInput& in, const SceneInput* known);
// Whether light goes past a material, as through a mask; not looked at: what a blend adds to it.
bool covers_partly(const SceneInput& in, uint32_t material);
// Whether light goes straight through or past a material, or what it blends with.
bool passes_straight(const SceneInput& in, uint32_t material);
// Whether a material lets light through, or its blend does.
bool clear_material(const SceneInput& in, uint32_t material);
std::string number(double x);
bool has_tangents(const SceneInput& in, uint32_t material);
uint32_t lookup_traits(uint32_t wrap, uint32_t filter, bool grey);
uint32_t padded(size_t n);

}  // namespace veriray
