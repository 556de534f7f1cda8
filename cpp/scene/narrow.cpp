// Views so narrow that float32 directions from the camera do not resolve their pixels, and parallel
// views of a small part of the scene.
#include <algorithm>
#include <array>
#include <vector>

#include "scene/scene.h"

namespace veriray {
namespace {

// Radians of a pixel from which on directions suffice; they are rounded to 2^-24.
constexpr double kNarrow = 0x1p-17;
// The reach of filters beyond the film, in pixels.
constexpr double kReach = 8;
// Rays start this high over the first faces in the view, in units: twice what planes of flat scenes
// and vertices are off.
constexpr double kHeight = 0x1p-20;
// Sines of angles to a face; what is seen from less has no extent.
constexpr double kEdgeOn = 0x1p-30;
// Distances from a start, in pixels, within which its rounding is a small part of one.
constexpr double kSharp = 0x1p20;

// The side n.p + w >= 0 of a plane.
struct Side {
    Double3 n;
    double w;
    double height(Double3 p) const { return dot(n, p) + w; }
};

// The least z of the part of a polygon on the side of all planes; infinity if there is none.
double least_depth(std::vector<Double3> polygon, const std::vector<Side>& planes) {
    for (const Side& side : planes) {
        std::vector<Double3> kept;
        for (size_t k = 0; k < polygon.size(); ++k) {
            const Double3 a = polygon[k], b = polygon[(k + 1) % polygon.size()];
            const double ha = side.height(a), hb = side.height(b);
            if (ha >= 0) kept.push_back(a);
            if ((ha < 0) != (hb < 0)) kept.push_back(a + (b - a) * (ha / (ha - hb)));
        }
        polygon = std::move(kept);
    }
    double least = INFINITY;
    for (const Double3 p : polygon) least = std::min(least, p.z);
    return least;
}

}  // namespace

double pixel_step(const SceneInput& in) {
    return 2 * std::min(in.tan_half_x / in.width, in.tan_half_y / in.height);
}

namespace {

// What a camera's view covers, and a little more, by planes; points as left, up, forward.
struct View {
    const SceneInput& in;
    Double3 eye;
    std::vector<Side> planes;

    View(const SceneInput& input, Double3 from)
        : in(input), eye(from), planes{{{0, 0, 1}, in.parallel ? -in.near_clip : 0}} {
        const double widens = in.parallel ? 0 : 1;  // the view, with the depth
        double least_width = 0;  // of a parallel view, for the rounding of what is clipped
        const auto reach = [&](Double3 at) {
            const Double3 p = seen(at);
            least_width = std::max({least_width, std::abs(p.x), std::abs(p.y)});
        };
        for (size_t i = 0; i < in.vertices.count && in.parallel; ++i) reach(row3(in.vertices, i));
        for (size_t i = 0; i < in.disks.count && in.parallel; ++i)
            for (const Double3 p : around_disk(i)) reach(p);
        least_width *= 0x1p-40;
        const auto between = [&](Double3 axis, double tan, double principal, double pixels) {
            const double margin = std::max(2 * tan * kReach / pixels, least_width);
            const double low = tan * (1 + 2 * principal) + margin,
                         high = tan * (1 - 2 * principal) + margin;
            planes.push_back({axis + Double3{0, 0, low * widens}, low * (1 - widens)});
            planes.push_back({axis * -1 + Double3{0, 0, high * widens}, high * (1 - widens)});
        };
        between({1, 0, 0}, in.tan_half_x, in.principal_x, in.width);
        between({0, 1, 0}, in.tan_half_y, in.principal_y, in.height);
    }

    Double3 seen(Double3 p) const {
        const double* m = in.to_world;
        const Double3 q = p - eye;
        return {m[0] * q.x + m[4] * q.y + m[8] * q.z, m[1] * q.x + m[5] * q.y + m[9] * q.z,
                m[2] * q.x + m[6] * q.y + m[10] * q.z};
    }

    // Corners of a parallelogram around a disk.
    std::array<Double3, 4> around_disk(size_t i) const {
        const Double3 c = row3(in.disks, 3 * i), a = row3(in.disks, 3 * i + 1),
                      b = row3(in.disks, 3 * i + 2);
        return {c + a + b, c + a - b, c - a - b, c - a + b};
    }

    // Calls f(least depth, three corners or more) for each triangle and disk in the view.
    template <class Visit>
    void each_face(Visit f) const {
        const auto visit = [&](std::vector<Double3> corners) {
            const double depth = least_depth(corners, planes);
            if (depth < INFINITY) f(depth, corners);
        };
        for (size_t i = 0; i < in.triangles.count; ++i) {
            const uint32_t* index = in.triangles.data + 3 * i;
            visit({seen(row3(in.vertices, index[0])), seen(row3(in.vertices, index[1])),
                   seen(row3(in.vertices, index[2]))});
        }
        for (size_t i = 0; i < in.disks.count; ++i) {
            std::vector<Double3> corners;
            for (const Double3 p : around_disk(i)) corners.push_back(seen(p));
            visit(std::move(corners));
        }
    }

    Double3 axis() const {
        if (in.parallel) return {0, 0, 1};
        return {-2 * in.principal_x * in.tan_half_x, -2 * in.principal_y * in.tan_half_y, 1};
    }
};

}  // namespace

double narrow_depth(const SceneInput& in, Double3 eye) {
    if (!in.parallel && !(pixel_step(in) < kNarrow)) return 0;
    if (in.camera_medium >= 0 || in.aperture_radius > 0) return 0;
    const View view(in, eye);
    const std::vector<Side>& planes = view.planes;
    const Double3 axis = normalised(view.axis());
    const double widest = std::max(in.tan_half_x, in.tan_half_y) * (1 + 2 * kReach);
    double least = INFINITY;
    view.each_face([&](double depth, auto&) { least = std::min(least, depth); });
    for (size_t i = 0; i < in.spheres.count; ++i) {
        const double* s = in.spheres.data + 4 * i;
        const Double3 c = view.seen({s[0], s[1], s[2]});
        if (std::any_of(planes.begin(), planes.end(),
                        [&](const Side& side) { return side.height(c) < -s[3] * length(side.n); }))
            continue;
        // The depth at which the axis meets it, less a bound for the view's width there; or else
        // that of the whole sphere.
        const double middle = dot(c, axis), d2 = dot(c, c) - middle * middle;
        const double half = std::sqrt(std::max(s[3] * s[3] - d2, 0.0));
        const double reach = in.parallel ? widest : widest * middle;
        const double wide = 2 * reach * std::sqrt(std::max(d2, 0.0)) / half;
        least = std::min(least, half > 16 * reach && middle - half > -planes[0].w
                                    ? (middle - half - wide) * axis.z
                                    : c.z - s[3]);
    }
    if (in.parallel) return std::max(least, in.near_clip);
    return least > in.near_clip ? least : 0;
}

double narrow_start(const SceneInput& in, Double3 eye, double depth, double unit) {
    const double pixel = pixel_step(in);
    const bool one_ray = in.parallel && pixel < 0x1p-40 * unit;
    const View view(in, eye);
    const Double3 axis = normalised(view.axis());
    // Starts lie on a plane across the axis, and so at other depths where that is not ahead.
    const double aside =
        in.parallel ? 0
                    : depth * (std::abs(axis.x) * in.tan_half_x * (1 + 2 * kReach / in.width) +
                               std::abs(axis.y) * in.tan_half_y * (1 + 2 * kReach / in.height));
    const double least = in.parallel
                             ? std::max({2 * in.tan_half_x, 2 * in.tan_half_y, 0x1p-16 * unit})
                             : 0x1p-10 * depth + aside;
    const double most =
        in.parallel
            ? std::max(least, unit * std::min(0x1p-8, one_ray ? 1 : kSharp * pixel / unit))
            : std::max(least, std::min(depth * std::min(1., kSharp * pixel), depth - in.near_clip));
    double start = least;
    view.each_face([&](double first, const std::vector<Double3>& c) {
        const Double3 n = cross(c[1] - c[0], c[2] - c[0]);
        const double slope = std::abs(dot(n, axis)) / length(n);
        if (slope > kEdgeOn)
            start = std::max(start, kHeight * unit / slope - (first - depth) + aside);
    });
    return std::min(start, most);
}

}  // namespace veriray
