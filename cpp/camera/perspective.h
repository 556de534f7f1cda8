// Pinhole and thin lens.
#pragma once

#include "camera/meter.h"
#include "core/mapping.h"
#include "geometry/ray.h"

namespace veriray {

struct CameraView {
    // Point of the plane one unit ahead under raster position (x, y) in pixels:
    // corner + x right + y down.
    float corner[3], right[3], down[3];
    float forward[3];
    float eye[3];
    float near_clip, far_clip;   // along forward; 0 and infinity: no clipping
    float lens_x[3], lens_y[3];  // half axes of the aperture; 0 for a pinhole
    float focus;                 // distance of the plane of focus along forward
    float before;       // rays start this far before the plane of the origin; 0: at the eye
    float plane[3][3];  // then the points of that plane, as corner, right and down; else 0
    MeterView meter;
};

// x, y: integer pixel; dx, dy: position relative to the pixel's corner. They are separate so that
// the position in the pixel keeps its bits in a wide film.
template <class F>
VR_HD Vec3<F> camera_point(const CameraView& c, F x, F y, F dx, F dy) {
    const Vec3<F> right = broadcast<F>(c.right), down = broadcast<F>(c.down);
    const Vec3<F> d = fma(right, x, fma(down, y, broadcast<F>(c.corner)));
    return fma(right, dx, fma(down, dy, d));
}

template <class L>
VR_HD Ray<L> pinhole_ray(const CameraView& c, Vec3<typename L::F> at) {
    using F = typename L::F;
    return {broadcast<F>(c.eye), at * (F(1.f) / sqrt(dot(at, at)))};
}

// The pinhole ray of a camera that is far from the scene around the origin. It starts a distance of
// `before` earlier than its point nearest to the origin, and passes through its point of a plane
// there, which is rounded as the scene is.
template <class L>
VR_HD Ray<L> far_ray(const CameraView& c, typename L::F x, typename L::F y, typename L::F dx,
                     typename L::F dy) {
    using F = typename L::F;
    const Vec3<F> d = pinhole_ray<L>(c, camera_point(c, x, y, dx, dy)).d;
    const Vec3<F> right = broadcast<F>(c.plane[1]), down = broadcast<F>(c.plane[2]);
    const Vec3<F> p = fma(right, x, fma(down, y, broadcast<F>(c.plane[0])));
    const Vec3<F> q = fma(right, dx, fma(down, dy, p));
    return {fma(d, -(dot(q, d) + F(c.before)), q), d};
}

// The ray from a uniform point on the aperture through the point in focus.
template <class L>
VR_HD Ray<L> lens_ray(const CameraView& c, Vec3<typename L::F> at, typename L::F u,
                      typename L::F v) {
    using F = typename L::F;
    F x, y;
    uniform_disk(u, v, x, y);
    const Vec3<F> o = fma(broadcast<F>(c.lens_x), x, broadcast<F>(c.lens_y) * y);
    const Vec3<F> d = fma(at, F(c.focus), -o);
    return {o + broadcast<F>(c.eye), d * (F(1.f) / sqrt(dot(d, d)))};
}

}  // namespace veriray
