// Pinhole camera.
#pragma once

#include "core/vec.h"

namespace veriray {

struct CameraView {
    float origin[3];
    // Direction through raster position (x, y) in pixels: corner + x right + y down.
    float corner[3], right[3], down[3];
    float forward[3];
    float near_clip, far_clip;  // along forward; 0 and infinity: not clipped
};

// x, y: integer pixel; dx, dy: position from the pixel's corner. The two are kept apart, so that a
// wide film does not eat the bits of the position in the pixel.
template <class L>
VR_HD Vec3<typename L::F> camera_direction(const CameraView& c, typename L::F x, typename L::F y,
                                           typename L::F dx, typename L::F dy) {
    using F = typename L::F;
    const Vec3<F> right = broadcast<F>(c.right), down = broadcast<F>(c.down);
    Vec3<F> d = fma(right, x, fma(down, y, broadcast<F>(c.corner)));
    d = fma(right, dx, fma(down, dy, d));
    return d * (F(1.f) / sqrt(dot(d, d)));
}

}  // namespace veriray
