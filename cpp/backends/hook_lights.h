// Rows of the light table for the hooks of the test suite.
#pragma once

#include "lights/light.h"

namespace veriray {

// All shapes, in a vacuum.
template <class L>
using AllLights = Lights<L, kAllShapes, false>;

// A sky of 4 x 3 texels of radiance a b, with a 1, 0, 3, 0 in a row and b 2, 1, 0 by rows. Guided,
// its left and right halves are patches, the right one with chances of 3/4 from x in [-1, 0), 1/4
// from [0, 1), both with y and z in [-1, 1), and 1/2 from elsewhere; of the left half the upper row
// has 3/4, of the right one 1/2.
struct HookSky {
    float texels[12 * kSkyFloats];
    float ends[10] = {0x1.8p23f, 0x1p24f,                      // rows
                      0x1p21f,   0x1p23f, 0x1.cp23f, 0x1p24f,  // of the first
                      0x1p21f,   0x1p23f, 0x1.cp23f, 0x1p24f};
    float sines[3] = {0, 1, 0};
    uint32_t guides[6] = {0, 1, 0, 3, 0, 3};
    float places[9] = {0x1p24f, 0x1p22f, 0x1p24f, 0x1p24f, 0x1.8p23f,
                       0x1p24f, 0x1p24f, 0x1p23f, 0x1p24f};
    float rows[4] = {0x1.8p23f, 0x1p24f, 0x1p23f, 0x1p24f};

    VR_HD HookSky() {
        for (uint32_t k = 0; k < 12 * kSkyFloats; ++k) {
            const uint32_t row = k / (4 * kSkyFloats), column = k / kSkyFloats % 4;
            const float a = column == 0 ? 1.f : column == 2 ? 3.f : 0.f;
            texels[k] = a * static_cast<float>(2 - row);
        }
    }
    VR_HD SkyMap map() const {
        SkyMap map{texels, ends, sines, guides, 4, 3, 0, 0, 2 / kPi, 2 / kPi, 0.25f * kPi * kPi,
                   1.f,    0.f,  {}};
        map.guide = {places, rows, {-1, -1, -1}, {1, 0.5f, 0.5f}, {2, 1, 1}, 1, 2, 1, 1};
        return map;
    }
};

// The row of a light of radiance 1 (intensity, irradiance): shape, p, e1, e2, n, offset, and 1 /
// the chance of being chosen, over the area for flat lights.
template <class L>
VR_HD auto light_of(const typename L::F* x, typename L::F offset, typename L::F chance,
                    const SkyMap& map) {
    using F = typename L::F;
    const F one(1.f);
    const Vec3<F> e1{x[4], x[5], x[6]}, e2{x[7], x[8], x[9]};
    const F a = sqrt(dot(e1, e1)), b = sqrt(dot(e2, e2));
    struct {
        F v[kLightMoreColumns];
    } more{{one, one / a, one / b, b / a, one / (a * b)}};
    return light_row<L>(
        [=](uint32_t c) {
            if (c == kLightShape) return x[0];
            if (c >= kLightMore) return more.v[c - kLightMore];
            if (c < kLightOffset) return x[1 + c - kLightP];
            if (c == kLightOffset) return offset;
            return c == kLightInverse ? one / chance : one;
        },
        map);
}

}  // namespace veriray
