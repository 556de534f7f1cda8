// What a light is on the host, which gives it to its shape.
#pragma once

#include "core/vec.h"

namespace veriray {

struct LightSource {
    uint32_t shape;
    double area;          // of lamps
    double cutoff, beam;  // degrees
    float radiance[3];    // intensity over squared length, or irradiance across the beam
    bool muted;           // its radiance is left out; all else stays
    double strength;      // sum of the channels, of a texture the mean
    double seen = 1;      // of a sky: the share of its light that arrives within the scene
    int32_t texture;      // -1: none
    Vec3<double> image_u, image_v;  // of lights at a point: where in an image a direction is
    Vec3<double> p, e1, e2, n;
    float offset;
    uint32_t primitive = ~0u, other = ~0u;  // that rays meet; the second triangle of a pair
    float record[8], side;                  // of a sphere (sphere.h)
};

// What a light can give, for the light tree; see lights/tree_view.h, whose numbers these are.
// Lengths are normalised; the strength is the sum of all channels.
struct LightBound {
    Vec3<double> p;
    double radius;
    Vec3<double> axis;
    double wide, edge;  // cosines
    double strength;
};

}  // namespace veriray
