// What faces and balls that touch are parted by (touching.cpp, concentric.cpp).
#pragma once

#include <algorithm>

#include "scene/scene.h"

namespace veriray {

// Separation as a share of the terms of n.p; half of it is for the heights from which the planes
// are seen, since each plane's distance along a ray is off by 2^-23 of the terms of the ray's
// origin.
inline constexpr double kParted = 0x1p-20;
static_assert(kParted == 2 * static_cast<double>(kLocalOffset));
// The largest number of nested bodies with faces in one plane.
inline constexpr int kMostLayers = 32;

// The length of shadow rays to a lamp, of which they lack 2^-21 (kShadowShorten), that counts for a
// body of that size which touches it. Of one that is solid and before the lamp, rays to the lamp
// begin within it. Of others it is less than any such ray only where faces would move by more than
// 2^-9 of the body.
inline double shadow_length(double extent, bool solid) {
    return std::min(4., (solid ? 1 : 0x1p12) * extent);
}

// In the frame.
inline Double3 ball_centre(const SceneInput& in, size_t k, Double3 centre, double unit) {
    const double* p = in.spheres.data + 4 * k;
    return (Double3{p[0], p[1], p[2]} - centre) * (1 / unit);
}

}  // namespace veriray
