// From arrays to normalised primitives.
#include "scene/scene.h"

#include <algorithm>
#include <numeric>

#include "scene/bounds.h"
#include "scene/thread_pool.h"

namespace veriray {
namespace {

// The smallest edge or height, the smallest width of a ball or disk, and the smallest distance of a
// point light, for which kEdgeSlack is negligible.
constexpr double kMinFlat = 0x1p-8, kMinBeside = 0x1p-6;
// The least radius or distance if rays leave faces by the rounding at their point. Then only
// kPlaneSlack matters, which shifts hits along the ray.
constexpr double kMinBesideLocal = 0x1p-11;
// The least distance of the pinhole and of point lights from faces: planes are up to 2 kPlaneSlack
// behind, which is 2^-15 of it, and radiance at a cosine c, like c^3, is off by 3 times that.
constexpr double kMinNear = 0x1p-6;
// The largest extinction for which kPlaneSlack is negligible.
constexpr double kMostFlatSigma = 0x1p8;

double rounded(double x) { return static_cast<double>(static_cast<float>(x)); }

// Splits a number into two halves that together hold 48 of its bits.
void split(double x, float& high, float& low) {
    high = static_cast<float>(x);
    low = static_cast<float>(x - static_cast<double>(high));
}

// The offset by which rays leave a plane n.p + w = 0 past the rounding of points on it: 16 units of
// 2^-24 of the terms of n.p (a rounded point put back on the plane, and the plane's distance seen
// from it), plus the distance of corners that are off the plane.
double leave(const float* plane, const Double3* corners, uint32_t count) {
    const Double3 n{plane[0], plane[1], plane[2]};
    double terms = 0, off = 0;
    for (uint32_t k = 0; k < count; ++k) {
        const Double3 v = corners[k];
        terms = std::max(terms, std::abs(n.x * v.x) + std::abs(n.y * v.y) + std::abs(n.z * v.z));
        off = std::max(off, std::abs(dot(n, v) + static_cast<double>(plane[3])));
    }
    return 0x1p-20 * terms + off;
}

// The terms of a plane's n.p below which the way that a rounded point is put back onto it may
// count more (kLocalMove): points are off a plane by 2^-23 of the terms of the ray's origin, whose
// coordinates are at most 8.
constexpr double kLeastTerms = 0x1p-18;

// Whether the rounding at a face's corners does not bound that at its points: of a large face that
// comes near to the origin, and of any whose plane nearly contains the origin. A plane across an
// axis that contains it is exact.
bool uneven(const float* plane, const Flat& f) {
    const Box box = box_of(f);
    double most = 0, near = std::abs(static_cast<double>(plane[3]));
    for (int c = 0; c < 3; ++c) {
        const double n = std::abs(static_cast<double>(plane[c]));
        most = std::max(most, n * std::max(-box.low[c], box.high[c]));
        near = std::max({near, box.low[c], -box.high[c]});
    }
    return most > 4 * near || (most > 0 && most < kLeastTerms);
}

}  // namespace

uint32_t padded(size_t n) {
    return static_cast<uint32_t>(std::max<size_t>(32, (n + 15) / 16 * 16));
}

HostScene::HostScene(const SceneInput& in) : view{}, width(in.width), height(in.height) {
    check_input(in, nullptr);
    has_normals_ =
        !all_fit(in.normals.count, [&](size_t i) { return !(length(row3(in.normals, i)) > 0); });
    if (in.primitives() > kMostSmall) bounds_ = std::make_shared<SceneBounds>(in);
    static_cast<Frame&>(*this) = frame_of(in);
    orient(in);
    if (!set_flat(in)) set_tree(in);
    view.primitives = primitives.data();
    list_surfaces(in);
    for (uint32_t stage = 0; stage < kStages; ++stage) {
        before_[stage] = view.features;
        run(static_cast<Stage>(stage), in);
    }
    before_[kStages] = view.features;
    set_camera(in);
    set_meter(in);
    set_filter(in);
}

void HostScene::run(Stage stage, const SceneInput& in) {
    if (stage == kSurfaceStage) set_surfaces(in);
    if (stage == kTextureStage) set_textures(in);
    if (stage == kMediumStage) set_media(in), set_grids(in), set_phases(in);
    if (stage == kLightStage) set_lights(in);
}

Double3 HostScene::point(const SceneInput& in, size_t vertex) const {
    const Double3 p = (row3(in.vertices, vertex) - centre) * (1.0 / unit);
    return {rounded(p.x), rounded(p.y), rounded(p.z)};
}

// Unit vertex normals of a smooth triangle; false if it is flat.
bool HostScene::vertex_normals(const SceneInput& in, size_t i, Double3 n[3]) const {
    if (!has_normals_) return false;
    for (int k = 0; k < 3; ++k) {
        const Double3 given = row3(in.normals, in.triangles.data[3 * i + k]);
        if (!(length(given) > 0)) return false;
        n[k] = normalised(given);
    }
    return true;
}

// The front is where the corners run counter-clockwise; of smooth meshes, where the vertex normals
// look (winding.cpp).
Flat HostScene::triangle(const SceneInput& in, size_t i) const {
    Flat f{};
    f.corners = 3;
    const uint32_t* index = in.triangles.data + 3 * i;
    for (int k = 0; k < 3; ++k) f.v[k] = point(in, index[k]);
    if (!turned_.empty() && turned_[i]) std::swap(f.v[1], f.v[2]), f.swapped = true;
    f.triangle = static_cast<uint32_t>(i);
    f.material = in.material(kTriangleGroup).data[i];
    f.emission = in.emission(kTriangleGroup).data[i];
    f.boundary = in.boundary(kTriangleGroup).data[i];
    return f;
}

// In a scene with flat primitives, the smallest `radii` of balls and disks, or distance of a point
// light from the boxes of the faces.
double HostScene::smallest_beside(const SceneInput& in, const std::vector<Flat>& flats,
                                  int radii) const {
    double smallest = INFINITY;
    if (flats.empty()) return smallest;
    for (size_t i = 0; i < in.spheres.count; ++i)
        smallest = std::min(smallest, in.spheres.data[4 * i + 3]);
    for (size_t i = 0; i < 2 * in.disks.count; ++i)
        smallest = std::min(smallest, length(row3(in.disks, 3 * (i / 2) + 1 + i % 2)));
    smallest *= radii / unit;
    std::vector<Box> boxes;
    for (const Flat& f : flats) boxes.push_back(box_of(f));
    for (size_t i = 0; i < in.light_kind.count; ++i) {
        if (!in.light_has_place(i)) continue;
        const Double3 p = (row3(in.light_position, i) - centre) * (1 / unit);
        for (const Box& box : boxes)
            smallest = std::min(smallest, std::sqrt(squared_gap({p, p}, box)));
    }
    return smallest;
}

// A lower bound of the distance of the pinhole and of point lights from faces.
double HostScene::nearest_point(const SceneInput& in, const std::vector<Flat>& flats) const {
    std::vector<Double3> points;
    if (!in.parallel) points.push_back((eye - centre) * (1 / unit));
    for (size_t i = 0; i < in.light_kind.count; ++i)
        if (in.light_has_place(i))
            points.push_back((row3(in.light_position, i) - centre) * (1 / unit));
    double nearest = INFINITY;
    for (const Flat& f : flats) {
        if (lets_through(in, kTriangleGroup, f.triangle)) continue;  // it has no slack
        const Double3 n = normalised(f.area_vector());
        const Box box = box_of(f);
        for (const Double3& p : points)
            nearest = std::min(nearest, std::max(std::abs(dot(n, p - f.v[0])),
                                                 std::sqrt(squared_gap({p, p}, box))));
    }
    return nearest;
}

// Whether a flat face may lie in a medium dense enough for kPlaneSlack to show. It may unless all
// that such media fill are spheres that meet no face.
bool HostScene::dense_beside(const SceneInput& in, const std::vector<Flat>& flats) const {
    const auto dense = [&](int64_t medium) {
        double sigma = 0;
        for (size_t k = 0; k < 3 && medium >= 0; ++k)
            sigma = std::max(sigma, static_cast<double>(in.sigma_t.data[3 * medium + k]));
        return sigma * unit > kMostFlatSigma;
    };
    if (dense(in.camera_medium)) return true;
    for (const ShapeGroup group : {kTriangleGroup, kSphereGroup, kDiskGroup})
        for (size_t i = 0; i < in.boundary(group).count; ++i) {
            const int32_t b = in.boundary(group).data[i];
            if (b < 0) continue;
            const bool filled = dense(in.boundaries.data[2 * b]);
            if (dense(in.boundaries.data[2 * b + 1]) || (filled && group != kSphereGroup))
                return true;
            if (!filled) continue;
            const double* s = in.spheres.data + 4 * i;
            const Double3 p = (Double3{s[0], s[1], s[2]} - centre) * (1 / unit);
            const double r = s[3] / unit * (1 - 0x1p-10);
            for (const Flat& f : flats)
                if (squared_gap({p, p}, box_of(f)) < r * r) return true;
        }
    return false;
}

// A small scene without a tree; false if it needs one.
bool HostScene::set_flat(const SceneInput& in) {
    const size_t round = in.spheres.count + in.disks.count;
    if (in.triangles.count > 4 * kMaxFlat || round > kMaxFlat) return false;
    if (has_normals_) return false;
    const auto give_up = [&] {
        dropped = 0;
        return false;
    };
    std::vector<Flat> flats;
    for (size_t i = 0; i < in.triangles.count; ++i) {
        flats.push_back(triangle(in, i));
        if (!(length(flats.back().area_vector()) > 0)) flats.pop_back(), ++dropped;
    }
    flats = merge_coplanar(
        flats, [&](const Flat& a, const Flat& b) { return same_texture_map(in, a, b); });
    double smallest = INFINITY;
    for (const Flat& f : flats)
        for (uint32_t k = 0; k < f.corners; ++k) {
            const double edge = length(f.v[(k + 1) % f.corners] - f.v[k]);
            smallest = std::min({smallest, edge, 2 * length(f.area_vector()) / edge});
        }
    if (flats.size() + round > kMaxFlat || smallest < kMinFlat) return give_up();
    std::stable_partition(flats.begin(), flats.end(),
                          [](const Flat& f) { return f.parallelogram; });
    // For faces that let light through, a ray that slips through an edge does no harm, but a rim or
    // a displaced plane would.
    const auto clear = [&](const Flat& f) { return lets_through(in, kTriangleGroup, f.triangle); };
    auto shared = shared_edges(flats);
    for (size_t i = 0; i < flats.size(); ++i)
        if (clear(flats[i])) shared[i].fill(false);
    const bool rims = rims_stick_out(flats, shared);
    const double beside = smallest_beside(in, flats, rims ? 2 : 1);
    if (beside < (rims ? kMinBeside : kMinBesideLocal) || nearest_point(in, flats) < kMinNear ||
        dense_beside(in, flats))
        return give_up();
    allocate_primitives(flats.size() + round, 1);
    for (size_t i = 0; i < flats.size(); ++i) {
        const Flat& f = flats[i];
        put_source(in, i, kTriangleGroup, f.triangle);
        float plane[4];
        write_plane(f, plane);
        bool widened = false;
        for (const bool w : shared[i]) widened |= w;
        const bool local = clear(f) || beside < kMinBeside;
        if (local) plane[3] = static_cast<float>(plane_at_origin(f));
        put_plane(i, f, plane, local ? kLocal : widened ? kEdgeSlack : 2 * kPlaneSlack);
        std::array<float, 4> rim{};
        // Paths leave both sides of a two-sided face, by as little as kPlaneSlack.
        const bool both = clear(f) || (local && in.sees_both_sides(f.material));
        const float behind = both ? 0.f : kPlaneSlack;
        if (f.parallelogram)
            write_quad(f, shared[i], behind, view.quads + kQuadFloats * view.quad_count++, rim);
        else
            write_polygon(f, shared[i], behind,
                          view.polygons + kPolygonFloats * view.polygon_count++, rim);
        if (local) plane_record(static_cast<uint32_t>(i))[3] = plane[3] + behind;
        for (uint32_t k = 0; k < 4; ++k) column(i, kPrimRim + k) = rim[k];
    }
    for (uint32_t i = 0; i < in.disks.count; ++i)
        put_disk(in, flats.size() + i, i, view.disks + kDiskFloats * view.disk_count++);
    view.first_sphere = static_cast<uint32_t>(flats.size() + in.disks.count);
    for (uint32_t i = 0; i < in.spheres.count; ++i)
        put_sphere(in, view.first_sphere + i, i,
                   view.spheres + kSphereFloats * view.sphere_count++);
    flats_ = std::move(flats);
    part_touching(in);
    part_backs(in);
    view.features = only_if(view.quad_count, kQuads) | only_if(view.polygon_count, kPolygons) |
                    only_if(view.disk_count, kDisks) | only_if(view.sphere_count, kSpheres);
    return true;
}

void HostScene::put_triangle(const SceneInput& in, size_t primitive, uint32_t row) {
    const Flat f = triangle(in, row);
    float plane[4];
    write_plane(f, plane);
    const bool local = uneven(plane, f);
    if (local) plane[3] = static_cast<float>(plane_at_origin(f));
    put_plane(primitive, f, plane, local ? kLocal : 0.f);
    put_source(in, primitive, kTriangleGroup, row);
    if (!smooth.empty()) put_smooth(in, primitive, f);
    float* r = &records[primitive * kRecordFloats];
    for (int k = 0; k < 9; ++k) r[k] = static_cast<float>(f.v[k / 3][k % 3]);
    std::copy_n(plane, 4, r + kRecordPlane);
    put_kind(primitive, kTriangleRecord);
}

void HostScene::put_kind(size_t primitive, uint32_t kind) {
    float* r = &records[primitive * kRecordFloats];
    r[kRecordId] = bit_cast<float>(static_cast<uint32_t>(primitive));
    r[kRecordKind] = bit_cast<float>(kind);
}

// Tables for a tree over `count` triangles, of these rows or null: of all, and what else there is,
// with the triangles in them.
void HostScene::put_triangles(const SceneInput& in, size_t count, const uint32_t* rows) {
    const size_t round = in.disks.count + in.spheres.count;
    allocate_primitives(count + round, in.spheres.count ? 12u : 8u);
    view.first_sphere = static_cast<uint32_t>(count + in.disks.count);
    if (has_normals_) smooth.resize(static_cast<size_t>(view.first_sphere) * kSmoothFloats);
    records.resize((count + round) * kRecordFloats);
    round_boxes.resize(6 * round);
    in_chunks(kAllThreads, count, [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i)
            put_triangle(in, i, rows ? rows[i] : static_cast<uint32_t>(i));
    });
}

// Triangles, discs and spheres, in this order, for one tree.
void HostScene::set_tree(const SceneInput& in) {
    constexpr size_t kMost = 1 << 27;
    size_t triangles = in.triangles.count;
    const size_t round = in.disks.count + in.spheres.count;
    const auto has_area = [&](size_t i) { return length(triangle(in, i).area_vector()) > 0; };
    const bool all = all_fit(triangles, has_area, 1);
    const std::vector<uint32_t> kept = all ? std::vector<uint32_t>{} : where(triangles, has_area);
    if (!all) triangles = kept.size();
    dropped = static_cast<uint32_t>(in.triangles.count - triangles);
    if (triangles + round >= kMost) throw std::invalid_argument("more than 2^27 - 1 primitives");
    put_triangles(in, triangles, all ? nullptr : kept.data());
    if (triangles + round == 0) return;

    const auto put_box = [&](size_t primitive, const Box& box) {
        float* b = &round_boxes[6 * (primitive - triangles)];
        for (int k = 0; k < 3; ++k)
            b[k] = static_cast<float>(box.low[k]), b[3 + k] = static_cast<float>(box.high[k]);
    };
    for (uint32_t i = 0; i < in.disks.count; ++i) {
        const size_t at = triangles + i;
        put_disk(in, at, i, &records[at * kRecordFloats]);
        put_kind(at, kDiskRecord);
        put_box(at, round_box(in, kDiskGroup, i));
        if (!smooth.empty()) put_smooth(in, at, Flat{});
    }
    for (uint32_t i = 0; i < in.spheres.count; ++i) {
        const size_t at = view.first_sphere + i;
        put_sphere(in, at, i, &records[at * kRecordFloats]);
        put_kind(at, kSphereRecord);
        put_box(at, round_box(in, kSphereGroup, i));
    }
    part_touching(in);
    part_twins(in);
    view.disk_count = static_cast<uint32_t>(in.disks.count);
    view.sphere_count = static_cast<uint32_t>(in.spheres.count);
    view.smooth = smooth.empty() ? nullptr : smooth.data();
    view.features = kBvh | only_if(!smooth.empty(), kSmooth) | only_if(view.disk_count, kDisks) |
                    only_if(view.sphere_count, kSpheres);
}

// Around a disk or sphere.
Box HostScene::round_box(const SceneInput& in, ShapeGroup group, uint32_t row) const {
    Double3 c, half;
    if (group == kSphereGroup) {
        const double* s = in.spheres.data + 4 * row;
        c = {s[0], s[1], s[2]}, half = {s[3], s[3], s[3]};
    } else {
        c = row3(in.disks, 3 * row);
        half = ellipse_reach(row3(in.disks, 3 * row + 1), row3(in.disks, 3 * row + 2));
    }
    return {(c - centre - half) * (1 / unit), (c - centre + half) * (1 / unit)};
}

// Around any primitive.
Box HostScene::box_around(const SceneInput& in, size_t primitive) const {
    const size_t flat = view.primitive_count - round_boxes.size() / 6;
    if (primitive < flats_.size()) return box_of(flats_[primitive]);
    if (records.empty() || primitive >= flat)
        return round_box(in, sources[primitive].group, sources[primitive].row);
    const float* r = &records[primitive * kRecordFloats];
    __builtin_prefetch(r + 8 * kRecordFloats);  // records are requested in order
    // By value: with references the compiler would branch.
    const auto least = [](float x, float y) { return y < x ? y : x; };
    const auto most = [](float x, float y) { return x < y ? y : x; };
    const auto low = [&](size_t k) { return least(least(r[k], r[3 + k]), r[6 + k]); };
    const auto high = [&](size_t k) { return most(most(r[k], r[3 + k]), r[6 + k]); };
    return {{low(0), low(1), low(2)}, {high(0), high(1), high(2)}};
}

// row 1: columns side by side for lookups; otherwise rows of that many floats.
void HostScene::allocate_primitives(size_t count, uint32_t row) {
    view.primitive_count = static_cast<uint32_t>(count);
    view.primitive_row = row;
    view.primitive_column = row == 1 ? padded(count) : 1;
    const size_t columns = row == 1 ? static_cast<size_t>(kPrimColumns) : row;
    primitives.resize(columns * padded(count));
    sources.resize(count);
    input_index.resize(count);
}

// least: what the offset needs to take a point past a neighbour's rim and the slack of its own
// plane; or kLocal.
void HostScene::put_plane(size_t primitive, const Flat& f, const float* plane, float least) {
    for (uint32_t k = 0; k < 3; ++k) column(primitive, kPrimN + k) = plane[k];
    column(primitive, kPrimPlane) = -plane[3];
    column(primitive, kPrimOffset) =
        least < 0 ? least
                  : std::max(least, static_cast<float>(leave(plane, f.v.data(), f.corners)));
}

void HostScene::put_disk(const SceneInput& in, size_t primitive, uint32_t row, float* record) {
    const Double3 c = (row3(in.disks, 3 * row) - centre) * (1 / unit);
    const Double3 a = row3(in.disks, 3 * row + 1) * (1 / unit),
                  b = row3(in.disks, 3 * row + 2) * (1 / unit);
    const Double3 n = cross(a, b);
    const double area = length(n);
    if (!(area > 0)) throw std::invalid_argument("disks[" + std::to_string(row) + "] has no area");
    Flat f{};
    f.corners = 4;
    f.v = {c + a, c + b, c - a, c - b};
    float plane[4];
    write_plane(f, plane);
    put_plane(primitive, f, plane, uneven(plane, f) ? kLocal : 0.f);
    std::copy_n(plane, 4, record);
    // U.p + w = 1 at c + a, 0 at c and along b; V likewise.
    const Double3 u = cross(b, n) * (1 / (area * area)), v = cross(n, a) * (1 / (area * area));
    for (int k = 0; k < 3; ++k) {
        record[4 + k] = static_cast<float>(u[k]);
        record[8 + k] = static_cast<float>(v[k]);
    }
    record[7] = static_cast<float>(-dot(u, c));
    record[11] = static_cast<float>(-dot(v, c));
    put_source(in, primitive, kDiskGroup, row);
}

void HostScene::put_sphere(const SceneInput& in, size_t primitive, uint32_t row, float* record) {
    const double* s = in.spheres.data + 4 * row;
    for (int k = 0; k < 3; ++k) split((s[k] - centre[k]) / unit, record[k], record[3 + k]);
    split(s[3] / unit, record[6], record[7]);
    if (!(record[6] >= 0x1p-100f))
        throw std::invalid_argument("spheres[" + std::to_string(row) + "] has the radius " +
                                    number(s[3]) + ", too small beside the scene");
    for (uint32_t k = 0; k < kSphereFloats; ++k) column(primitive, k) = record[k];
    column(primitive, kPrimSide) = in.sphere_inward.data[row] ? -1.f : 1.f;
    put_source(in, primitive, kSphereGroup, row);
}

// Normals at the corners as an affine function of the point; a flat triangle's is constant.
void HostScene::put_smooth(const SceneInput& in, size_t primitive, const Flat& f) {
    float* out = &smooth[primitive * kSmoothFloats];
    const Double3 flat{column(primitive, kPrimN), column(primitive, kPrimN + 1),
                       column(primitive, kPrimN + 2)};
    Double3 n[3] = {flat, flat, flat};
    if (f.corners == 3 && !vertex_normals(in, f.triangle, n)) n[0] = n[1] = n[2] = flat;
    if (f.swapped) std::swap(n[1], n[2]);
    const Double3 e1 = f.v[1] - f.v[0], e2 = f.v[2] - f.v[0], m = cross(e1, e2);
    const double m2 = dot(m, m);
    const Double3 a1 = m2 > 0 ? cross(e2, m) * (1 / m2) : Double3{0, 0, 0};
    const Double3 a2 = m2 > 0 ? cross(m, e1) * (1 / m2) : Double3{0, 0, 0};
    for (int k = 0; k < 3; ++k) {
        const Double3 g = a1 * (n[1][k] - n[0][k]) + a2 * (n[2][k] - n[0][k]);
        for (int c = 0; c < 3; ++c) out[4 * k + c] = static_cast<float>(g[c]);
        out[4 * k + 3] = static_cast<float>(n[0][k] - dot(g, f.v[0]));
    }
}

void HostScene::put_source(const SceneInput& in, size_t primitive, ShapeGroup group, uint32_t row) {
    int32_t emission = in.emission(group).data[row];
    if (emission >= 0) {
        const float* e = in.emissions.data + 3 * emission;
        if (!(e[0] > 0 || e[1] > 0 || e[2] > 0)) emission = -1;
    }
    sources[primitive] = {group, row, in.material(group).data[row], emission,
                          in.boundary(group).data[row]};
    const size_t before[3] = {0, in.triangles.count, in.triangles.count + in.spheres.count};
    input_index[primitive] = static_cast<uint32_t>(before[group] + row);
}

size_t HostScene::memory() const {
    return sizeof(SceneView) +
           4 * (primitives.size() + smooth.size() + light_chance.size() + light_row.size() +
                surfaces.size() + media.size() + light_table.size() + filter_edges.size() +
                surface_of.size() + light_tree.size() + records.size() + round_boxes.size() +
                uv.size() + tangents.size() + textures.size() + texels.size() + sky_texels.size() +
                sky_ends.size() + sky_sines.size() + sky_places.size() + sky_rows.size() +
                sky_guides.size() + grids.size() + cells.size() + lobes.size() +
                phase_values.size() + phase_drawn.size() + phase_ends.size() + phase_guides.size() +
                meter_patches.size() + meter_guides.size());
}

}  // namespace veriray
