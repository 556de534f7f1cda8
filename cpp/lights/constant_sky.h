// The same radiance from everywhere. It has no light samples: sampled directions meet all of it
// alike.
#pragma once

#include "lights/shape.h"

namespace veriray {

template <class L>
struct ConstantSky : LightShape<L> {
    VR_LIGHT_SHAPE(LightShape<L>);
    static constexpr const char *kName = "constant_sky", *kFeature = "environment";
    static constexpr LightSite kSite = kAllAround;
    static constexpr bool kSampled = false;

    template <class Row>
    static VR_HD S radiance(const Row& row, V) {
        return row.radiance();
    }
    template <class Row>
    static VR_HD Emission emit(const Row& row, Numbers r) {
        const V d = Base::any_direction(r.s, r.t);
        return {Base::before_scene(d, r.u, r.v),
                d,
                row.radiance(),
                F(1.f),
                F(1.f) / (row(kLightInverse) * F(kSceneArea)),
                F(Base::kAnyPdf)};
    }
    // Across a disc of radius 1, as of a directional light.
    static VR_HD double power(const LightSource& s) {
        return 4 * kPiDouble * kPiDouble * s.strength;
    }
    static LightBound bound(const LightSource& s) {
        return {{0, 0, 1}, kFromAllAround, {0, 0, 0}, -1, 0, kPiDouble * s.strength};
    }
    template <class At>
    static void write(const LightSource&, At) {}
};

}  // namespace veriray
