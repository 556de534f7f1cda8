// Triangles, from a corner along two edges.
#pragma once

#include "lights/flat.h"

namespace veriray {

template <class L>
struct TriangleLight : FlatLight<L, TriangleLight<L>> {
    VR_LIGHT_SHAPE(FlatLight<L, TriangleLight<L>>);
    static constexpr const char *kName = "triangle", *kFeature = "triangle_lights";
    static constexpr bool kSpreads = true;
    static constexpr double kMiddle = 1. / 3;
    static Vec3<double> corner(const LightSource& s, int k) {
        return s.p + s.e1 * (k == 1 ? 1. : 0.) + s.e2 * (k == 2 ? 1. : 0.);
    }

    static VR_HD void spread(F u, F v, F& a, F& b) { uniform_triangle(u, v, a, b); }
};

}  // namespace veriray
