// Elementary functions made of IEEE operations only: the same bits on every machine and lane width.
#pragma once

#include "core/lane.h"

namespace veriray {

inline constexpr float kPi = 3.14159265358979323846f;
inline constexpr float kInvPi = 0.318309886183790671538f;
inline constexpr float kInfinity = __builtin_huge_valf();

// s = sin(2 pi u), c = cos(2 pi u) for u in [0, 1).
// Quarter turns are taken off exactly; the rest |r| <= 1/2 of a quarter goes through minimax
// polynomials (Remez, relative error 3.3e-9 and 5.7e-11 before rounding).
// Over all 2^24 multiples of 2^-24: at most 1.69 ulp and 8.4e-8 (tests/unit/test_math.py).
template <class F>
VR_HD void sincos_2pi(F u, F& s, F& c) {
    const F x = u * F(4.f);
    const auto q = to_uint(x + F(0.5f));
    const F r = x - to_float(q);
    const F r2 = r * r;
    const F sin_r =
        r * fma(r2, fma(r2, fma(r2, F(-0x1.2d9302p-8f), F(0x1.465e92p-4f)), F(-0x1.4abbbap-1f)),
                F(0x1.921fb6p+0f));
    const F cos_r =
        fma(r2,
            fma(r2, fma(r2, fma(r2, F(0x1.d99f54p-11f), F(-0x1.55c4eap-6f)), F(0x1.03c1dap-2f)),
                F(-0x1.3bd3ccp+0f)),
            F(1.f));
    using U = decltype(as_uint(u));
    const auto odd = (q & U(1u)) == U(1u);
    s = as_float(as_uint(select(odd, cos_r, sin_r)) ^ ((q & U(2u)) << 30));
    c = as_float(as_uint(select(odd, sin_r, cos_r)) ^ (((q + U(1u)) & U(2u)) << 30));
}

}  // namespace veriray
