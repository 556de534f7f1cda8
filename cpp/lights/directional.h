// Parallel light from far away.
#pragma once

#include "core/math.h"
#include "lights/shape.h"

namespace veriray {

template <class L>
struct DirectionalLight : LightShape<L> {
    VR_LIGHT_SHAPE(LightShape<L>);
    static constexpr const char *kName = "directional", *kFeature = "delta_lights";
    static constexpr LightSite kSite = kFarAway;
    static constexpr bool kAimed = true;

    template <class Row>
    static VR_HD Sample sample_li(const Row& row, V, V, F, F, M lanes, M) {
        return {row.radiance(), row(kLightInverse), F(kInfinity), -row.vector(kLightN), lanes,
                U(~0u)};
    }
    template <class Row>
    static VR_HD Emission emit(const Row& row, Numbers r) {
        const V d = row.vector(kLightN);
        return {Base::before_scene(d, r.u, r.v),
                d,
                row.radiance(),
                F(1.f),
                F(1.f) / (row(kLightInverse) * F(kSceneArea)),
                F(1.f)};
    }
    // Across a disc of radius 1: a third of what covers the scene.
    static VR_HD double power(const LightSource& s) { return kPiDouble * s.strength; }
    static LightBound bound(const LightSource& s) {
        return {-s.n, kFromFar, {0, 0, 0}, -1, 0, s.strength};
    }
    template <class At>
    static void write(const LightSource& s, At at) {
        Base::write3(at, kLightN, s.n);
    }
};

}  // namespace veriray
