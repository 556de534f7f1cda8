// Who receives light, as the choice among lights sees it.
#pragma once

#include "core/vec.h"

namespace veriray {

// Where light is scattered: its position, and which directions count, as one word (see facing()).
template <class L>
struct LightReceiver {
    Vec3<typename L::F> p;
    typename L::U facing;
};

enum Facing : uint32_t {
    kAllSides = 0,  // a place in a medium
    kOneSide = 1,   // directions on the side of the normal
    kBothSides = 2,
};

// A normal rounded to 15 bits for each of two coordinates on an octahedron, and which sides count.
// The chance where a light is sampled and where it is met follow from the same word.
template <class U, class F>
VR_HD U facing(Vec3<F> n, U sides) {
    const F zero(0.f), one(1.f);
    const F inverse = one / (abs(n.x) + abs(n.y) + abs(n.z));
    const F a = n.x * inverse, b = n.y * inverse;
    const auto below = n.z < zero;
    const F over_a = select(a < zero, abs(b) - one, one - abs(b));
    const F over_b = select(b < zero, abs(a) - one, one - abs(a));
    const auto code = [](F x) VR_INLINED { return to_uint(fma(x, F(16383.f), F(16384.5f))); };
    return (code(select(below, over_a, a)) << 17) | (code(select(below, over_b, b)) << 2) | sides;
}
template <class F, class U>
VR_HD Vec3<F> facing_normal(U word) {
    const F zero(0.f), one(1.f);
    const auto number = [](U code)
                            VR_INLINED { return (to_float(code) - F(16384.f)) * F(1.f / 16383.f); };
    const F a = number(word >> 17), b = number((word >> 2) & U(0x7fffu));
    const F z = one - abs(a) - abs(b);
    const auto below = z < zero;
    const F over_a = select(a < zero, abs(b) - one, one - abs(b));
    const F over_b = select(b < zero, abs(a) - one, one - abs(a));
    const Vec3<F> n{select(below, over_a, a), select(below, over_b, b), z};
    return n * (one / sqrt(dot(n, n)));
}

// a - b.
template <class U>
VR_HD U less(U a, U b) {
    return a + (b ^ U(~0u)) + U(1u);
}

}  // namespace veriray
