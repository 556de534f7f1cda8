// Origin and unit of the scene's normalised lengths.
#include <algorithm>

#include "scene/bounds.h"

namespace veriray {
namespace {

// Distance of the camera, in sizes of the scene, from which on the scene's middle is the origin.
constexpr double kFar = 8;
// 2^8 times the rounding of positions near the middle, in sizes of the scene; it must not exceed a
// pixel there.
constexpr double kRounded = 0x1p-16;
// Distance of details, in their sizes, from which on another origin is sought.
constexpr double kCoarse = 0x1p7;
// Distances of flat shapes, in their sizes: within the first they are always near enough; beyond
// the second they are lost, as their corners are off by half of their sizes.
constexpr double kCoarseShape = 0x1p12, kLostShape = 0x1p22;

// Calls f(point, extent by axis) for every corner of triangles with an area, sphere and disk: other
// vertices are nowhere in the picture.
template <class Visit>
void each_extent(const SceneInput& in, Visit f) {
    for (size_t i = 0; i < in.triangles.count; ++i) {
        Double3 v[3];
        for (size_t k = 0; k < 3; ++k) v[k] = row3(in.vertices, in.triangles.data[3 * i + k]);
        if (length(cross(v[1] - v[0], v[2] - v[0])) > 0)
            for (const Double3 p : v) f(p, Double3{0, 0, 0});
    }
    for (size_t i = 0; i < in.spheres.count; ++i) {
        const double* s = in.spheres.data + 4 * i;
        f(Double3{s[0], s[1], s[2]}, Double3{s[3], s[3], s[3]});
    }
    for (size_t i = 0; i < in.disks.count; ++i)
        f(row3(in.disks, 3 * i),
          ellipse_reach(row3(in.disks, 3 * i + 1), row3(in.disks, 3 * i + 2)));
}

// A place, and a length there; rounding must be small compared with it.
struct Detail {
    Double3 at;
    double size;
};

// The details of a small scene, and its flat shapes. Lamps count by their distance from surfaces,
// which rounding moves by 2^-20 of their position, and flat lamps by their size too, which it
// changes by 2^-23. Media count by the mean free path, 2^-22.
std::vector<Detail> details(const SceneInput& in, std::vector<Detail>& shapes) {
    std::vector<Detail> list;
    if (in.primitives() > kMostSmall) return list;
    struct Lamp {
        Double3 at, n;  // n: normal of a flat lamp, which lights what is in front; else 0
        double size, nearest = INFINITY;
        ShapeGroup group = kTriangleGroup;
        size_t row = SIZE_MAX;
    };
    std::vector<Lamp> lamps;
    for (size_t q = 0; q < in.light_kind.count; ++q)
        if (in.light_has_place(q)) lamps.push_back({row3(in.light_position, q), {0, 0, 0}, 0});
    // f(group, row, middle, normal, size, distance of a point), for every shape
    const auto each_shape = [&](auto f) {
        // A lower bound of the distance to something that lies in a plane and in a box.
        const auto flat = [](Double3 at, Double3 n, Box box) {
            return [at, n = normalised(n), box](Double3 p) {
                return std::max(std::abs(dot(n, p - at)), std::sqrt(squared_gap({p, p}, box)));
            };
        };
        for (size_t i = 0; i < in.spheres.count; ++i) {
            const double* s = in.spheres.data + 4 * i;
            const Double3 c{s[0], s[1], s[2]};
            f(kSphereGroup, i, c, Double3{0, 0, 0}, s[3],
              [&](Double3 p) { return length(p - c) - s[3]; });
        }
        for (size_t i = 0; i < in.disks.count; ++i) {
            const Double3 c = row3(in.disks, 3 * i), a = row3(in.disks, 3 * i + 1),
                          b = row3(in.disks, 3 * i + 2);
            const Double3 reach = ellipse_reach(a, b);
            f(kDiskGroup, i, c, cross(a, b), length(a),
              flat(c, cross(a, b), {c - reach, c + reach}));
        }
        for (size_t i = 0; i < in.triangles.count; ++i) {
            const uint32_t* index = in.triangles.data + 3 * i;
            const Double3 a = row3(in.vertices, index[0]), b = row3(in.vertices, index[1]),
                          c = row3(in.vertices, index[2]), n = cross(b - a, c - a);
            if (length(n) > 0)
                f(kTriangleGroup, i, (a + b + c) * (1.0 / 3), n, length(b - a),
                  flat(a, n, around({a, a}, around({b, b}, {c, c}))));
        }
    };
    each_shape([&](ShapeGroup group, size_t row, Double3 at, Double3 n, double size, auto) {
        if (group != kSphereGroup) shapes.push_back({at, size});  // spheres are exact anywhere
        if (in.emission(group).data[row] >= 0) lamps.push_back({at, n, size, INFINITY, group, row});
    });
    each_shape([&](ShapeGroup group, size_t row, Double3 at, Double3, double, auto distance) {
        for (Lamp& lamp : lamps)  // its own plane does not count
            if (const double d = std::abs(distance(lamp.at));
                (group != lamp.group || row != lamp.row) && d > 0.01 * lamp.size &&
                dot(lamp.n, at - lamp.at) >= 0)
                lamp.nearest = std::min(lamp.nearest, d);
        const int32_t b = in.boundary(group).data[row];
        double path = INFINITY;
        for (int k = 0; b >= 0 && k < 2; ++k)
            if (const int32_t m = in.boundaries.data[2 * b + k]; m >= 0)
                for (int c = 0; c < 3; ++c)
                    path = std::min(path, 1 / static_cast<double>(in.sigma_t.data[3 * m + c]));
        if (std::isfinite(path)) list.push_back({at, 4 * path});
    });
    for (const Lamp& lamp : lamps)
        if (lamp.nearest > 0 && std::isfinite(lamp.nearest))
            list.push_back({lamp.at, length(lamp.n) > 0 ? std::min(lamp.nearest, 8 * lamp.size)
                                                        : lamp.nearest});
    return list;
}

// The place for the origin: the given one, or the mean of all details weighted by fineness. The
// mean is taken if some detail is too far from the given place, if the mean halves that distance,
// and if no shape comes too far away: more than four times as far as now, unless it is lost now.
Double3 finest(const SceneInput& in, Double3 given) {
    std::vector<Detail> shapes;
    const std::vector<Detail> list = details(in, shapes);
    const auto coarsest = [](const std::vector<Detail>& of, Double3 from) {
        double most = 0;
        for (const Detail& d : of) most = std::max(most, length(d.at - from) / d.size);
        return most;
    };
    const double here = coarsest(list, given);
    if (!(here > kCoarse)) return given;
    double least = INFINITY, total = 0;
    for (const Detail& d : list) least = std::min(least, d.size);
    Double3 sum{0, 0, 0};
    for (const Detail& d : list) {
        const double w = least / d.size * (least / d.size);
        sum = sum + (d.at - given) * w;
        total += w;
    }
    const Double3 mean = given + sum * (1 / total);
    std::erase_if(shapes,
                  [&](const Detail& d) { return length(d.at - given) > kLostShape * d.size; });
    const double shape = std::max(4 * coarsest(shapes, given), kCoarseShape);
    return coarsest(list, mean) * 2 < here && coarsest(shapes, mean) <= shape ? mean : given;
}

// The origin for a camera within a large scene: the middle of the cell around the camera. The cell
// is the whole scene, or one of a grid about the scene's middle, so large that 2^8 times the
// rounding of what is nearest to the camera does not exceed a pixel. near: its distance.
Double3 cell(Double3 eye, Double3 middle, double size, double pixel, double near) {
    constexpr int kFiner = 3;           // powers of two between grids
    constexpr double kLeast = 0x1p-40;  // of a cell, in sizes of the scene
    const double edge = pixel * near / kRounded;
    if (size <= edge) return middle;
    const int whole = std::ilogb(size) + 1;
    if (!(edge > kLeast * size)) return eye;
    const int finer = (whole - std::ilogb(edge) + kFiner - 1) / kFiner;
    const double side = std::ldexp(1.0, whole - kFiner * finer);
    const auto snapped = [&](double x, double m) {
        return m + side * std::floor((x - m) / side + 0.5);
    };
    return {snapped(eye.x, middle.x), snapped(eye.y, middle.y), snapped(eye.z, middle.z)};
}

}  // namespace

// The origin is the camera, near which rounding is then small, or a place where it must be small;
// in a large scene the middle of a cell around the camera, so that the form of the scene is one for
// many cameras. If the scene is small compared with its distance, and only the pinhole ties it to
// the camera, the origin is its middle. If the view is too narrow for these, it is the first thing
// in the view. Nothing ties a parallel view to the place of its camera: rays start before all that
// they meet.
Frame HostScene::frame_of(const SceneInput& in) const {
    Frame f{};
    Double3 &eye = f.eye, &centre = f.centre;
    eye = centre = {in.to_world[3], in.to_world[7], in.to_world[11]};
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    if (bounds_)
        for (int k = 0; k < 3; ++k)
            low[k] = bounds_->all().low[k], high[k] = bounds_->all().high[k];
    else
        each_extent(in, [&](Double3 p, Double3 r) {
            for (int k = 0; k < 3; ++k)
                low[k] = std::min(low[k], p[k] - r[k]), high[k] = std::max(high[k], p[k] + r[k]);
        });
    f.extent = {{low[0], low[1], low[2]}, {high[0], high[1], high[2]}};
    bool far = false;
    double size = 0, gap = 0, middle[3], depth[2] = {0, 0};
    for (int k = 0; k < 3; ++k) {
        const double forward = in.to_world[4 * k + 2];
        middle[k] = low[k] + 0.5 * (high[k] - low[k]);
        size = std::max(size, high[k] - low[k]);
        gap = std::max({gap, low[k] - eye[k], eye[k] - high[k]});
        depth[0] += std::min(forward * (low[k] - eye[k]), forward * (high[k] - eye[k]));
        depth[1] += std::max(forward * (low[k] - eye[k]), forward * (high[k] - eye[k]));
    }
    if (gap > kFar * size && size > 0 && std::isfinite(gap) && depth[0] > in.near_clip &&
        depth[1] < in.far_clip && in.camera_medium < 0 && in.aperture_radius == 0) {
        centre = {middle[0], middle[1], middle[2]};
        far = true;
    }
    const bool parallel = in.parallel;
    if (parallel && low[0] <= high[0]) centre = {middle[0], middle[1], middle[2]};
    const bool fine = (far || parallel) && kRounded * size < pixel_step(in) * (parallel ? 1 : gap);
    const double depth_seen = fine ? 0 : narrow_depth(in, eye);
    const bool narrow =
        std::isfinite(depth_seen) &&
        (parallel ? !fine && in.camera_medium < 0 : depth_seen > 0 && depth[1] < in.far_clip);
    const bool large = bounds_ != nullptr;
    if (narrow) {
        far = false;
        const double* m = in.to_world;
        const double widens = parallel ? 1 : depth_seen;
        const double x = -2 * in.principal_x * in.tan_half_x * widens,
                     y = -2 * in.principal_y * in.tan_half_y * widens, z = depth_seen;
        centre = eye + Double3{m[0] * x + m[1] * y + m[2] * z, m[4] * x + m[5] * y + m[6] * z,
                               m[8] * x + m[9] * y + m[10] * z};
    } else if (!large) {
        centre = finest(in, centre);
    } else if (!far && !parallel && size > 0 && std::isfinite(size)) {
        // The scene's box is nearer than all in it: often that suffices.
        double near = gap - in.aperture_radius;
        if (!(kRounded * size <= pixel_step(in) * near))
            near = bounds_->nearest(in, eye) - in.aperture_radius;
        centre = cell(eye, {middle[0], middle[1], middle[2]}, size, pixel_step(in), near);
    }
    double most = 0;
    if (large)
        for (int k = 0; k < 3; ++k)
            most = std::max({most, high[k] - centre[k], centre[k] - low[k]});
    else
        each_extent(in, [&](Double3 p, Double3 r) {
            for (int k = 0; k < 3; ++k) most = std::max(most, std::abs(p[k] - centre[k]) + r[k]);
        });
    if (!far && !narrow && (!parallel || in.camera_medium >= 0)) {
        // In a large scene by the distance, which is the same all around it.
        if (large) most = std::max(most, length(eye - centre) + in.aperture_radius);
        for (int k = 0; k < 3; ++k)
            most = std::max(most, std::abs(eye[k] - centre[k]) + in.aperture_radius);
    }
    if (!std::isfinite(most)) throw std::invalid_argument("the scene's extent is not finite");
    const double unit = f.unit = most > 0 ? std::ldexp(1.0, std::ilogb(most) + 1) : 1.0;
    if (parallel)  // by more than the rounding of large faces
        f.before = 4 * unit;
    else
        f.before = far ? 4 * unit : 0;
    if (narrow) f.before = narrow_start(in, eye, depth_seen, unit);
    return f;
}

}  // namespace veriray
