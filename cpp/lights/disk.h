// Ellipses, from the centre along two half axes.
#pragma once

#include "lights/flat.h"

namespace veriray {

template <class L>
struct DiskLight : FlatLight<L, DiskLight<L>> {
    VR_LIGHT_SHAPE(FlatLight<L, DiskLight<L>>);
    static constexpr const char *kName = "disk", *kFeature = "disk_lights";
    static constexpr bool kSpreads = true;
    static constexpr double kMiddle = 0;
    static Vec3<double> corner(const LightSource& s, int k) {
        return s.p + s.e1 * (k & 1 ? 1. : -1.) + s.e2 * (k & 2 ? 1. : -1.);
    }

    static VR_HD void spread(F u, F v, F& a, F& b) { uniform_disk(u, v, a, b); }
};

}  // namespace veriray
