// What a light gives, by its true distance.
#pragma once

#include "core/math.h"
#include "core/vec.h"

namespace veriray {

// Shadow rays leave surfaces, and end before lamps, by bounds on rounding. What a light gives
// follows from the way between the points themselves, which is `apart` longer than the ray's, `to`;
// inverse: of the length. Returns the direction, unit, and makes `inverse` that of the true length:
// 1 / sqrt(1 + z) to the square of z, the relative change of the squared length; 5/16 z^3 remain,
// 2^-19 at most. Where z is larger, float32 resolves neither way.
template <class F>
VR_HD Vec3<F> true_way(Vec3<F> to, Vec3<F> apart, F& inverse) {
    const F z = dot(apart, fma(to, F(2.f), apart)) * (inverse * inverse);
    const auto resolved = abs(z) < F(0x1p-6f);
    const F change = fma(z, fma(z, F(0.375f), F(-0.5f)), F(1.f));
    inverse = select(resolved, inverse * change, inverse);
    return select(resolved, to + apart, to) * inverse;
}

}  // namespace veriray
