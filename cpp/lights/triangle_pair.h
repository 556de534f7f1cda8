// Parallelograms of two triangles, as meshes and trees hold them: one lamp, met as either half.
#pragma once

#include "lights/flat.h"

namespace veriray {

template <class L>
struct TrianglePairLight : FlatLight<L, TrianglePairLight<L>> {
    VR_LIGHT_SHAPE(FlatLight<L, TrianglePairLight<L>>);
    static constexpr const char *kName = "triangle_pair", *kFeature = "triangle_lights";
    static constexpr bool kPaired = true;

    template <class At>
    static void write(const LightSource& s, At at) {
        Base::write(s, at);
        at(kLightOther) = bit_cast<float>(s.other);
    }
};

}  // namespace veriray
