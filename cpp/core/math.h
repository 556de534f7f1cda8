// Elementary functions made of IEEE operations only: the same bits on every machine and lane width.
// The polynomials are minimax by Remez' exchange; coefficients were rounded one after another, and
// the rest fitted again each time. The errors stated are the largest over all floats of the domain
// (log, exp_minus) and over all 2^24 multiples of 2^-24 (sincos_2pi):
// veriray_validate/levels/numbers.py.
#pragma once

#include "core/lane.h"

namespace veriray {

inline constexpr float kPi = 3.14159265358979323846f;
inline constexpr float kInvPi = 0.318309886183790671538f;
inline constexpr float kInfinity = __builtin_bit_cast(float, 0x7f800000u);
// ln 2 as the sum of two numbers; products of the first with up to 7 bits are exact.
inline constexpr float kLn2High = 0x1.62e4p-1f, kLn2Low = 0x1.7f7d1cp-20f;
inline constexpr float kRootHalf = 0x1.6a09e6p-1f;

// For lanes; platform.h has the version for float and states what holds.
template <class F>
VR_HD F plain_quotient(F a, F b) {
    return a / b;
}

// s = sin(2 pi u), c = cos(2 pi u) for u in [0, 1).
// Quarter turns are subtracted exactly. Minimax polynomials take the rest, |r| <= 1/2 of a quarter
// (relative errors 3.3e-9 and 5.7e-11 before rounding).
// At most 1.69 ulp and 8.4e-8.
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

// c[0] + c[1] x + ... + c[n - 1] x^(n - 1).
template <class F, int n>
VR_HD F polynomial(F x, const float (&c)[n]) {
    F sum(c[n - 1]);
    for (int k = n - 2; k >= 0; --k) sum = fma(sum, x, F(c[k]));
    return sum;
}

// log((1 + f) 2^e) for 1 + f in [sqrt(1/2), sqrt(2)]; accurate for f near 0 if e = 0.
// The polynomial's relative error is 4.2e-9.
template <class F>
VR_HD F log_of_parts(F f, F e) {
    constexpr float c[] = {-0x1.fffff8p-2f, 0x1.55555p-2f,   -0x1.00043p-2f,
                           0x1.99a3a4p-3f,  -0x1.542548p-3f, 0x1.227b56p-3f,
                           -0x1.0f57ecp-3f, 0x1.0803b2p-3f,  -0x1.36b9e2p-4f};
    const F rest = fma(f * f, polynomial(f, c), e * F(kLn2Low));
    return fma(e, F(kLn2High), f + rest);
}

// x = (1 + f) 2^e, exactly.
template <class F>
VR_HD void float_parts(F x, F& f, F& e) {
    using U = decltype(as_uint(x));
    const U root_half = U(0x3f3504f3u);  // of kRootHalf
    const U shifted = as_uint(x) + U(0x3f800000u - 0x3f3504f3u);
    e = to_float(shifted >> 23) - F(127.f);
    f = as_float((shifted & U(0x7fffffu)) + root_half) - F(1.f);
}

// Natural logarithm of a positive normal float. At most 0.88 ulp; monotone; log(1) = 0.
template <class F>
VR_HD F log(F x) {
    F f, e;
    float_parts(x, f, e);
    return log_of_parts(f, e);
}

// e^-x for x >= 0, infinity included; exp_minus(0) = 1.
// 0 beyond 87.33654, where the value leaves the normal floats (2^-126). NaN stays NaN.
// At most 1.02 ulp; monotone. The polynomial's relative error is 3.2e-9.
template <class F>
VR_HD F exp_minus(F x) {
    using U = decltype(as_uint(x));
    constexpr float largest = 0x1.5d589ep+6f;
    constexpr float c[] = {0x1.fffffcp-2f, -0x1.55548cp-3f, 0x1.555858p-5f, -0x1.123dep-7f,
                           0x1.6ac74cp-10f};
    const F y = min(F(largest), x);
    const F round(0x1.8p23f);  // adding it leaves an integer in the low bits
    const F shifted = fma(y, F(-0x1.715476p+0f), round);
    const F n = shifted - round;
    const F r = fma(n, F(kLn2Low), fma(n, F(kLn2High), y));
    const F value = F(1.f) + fma(r * r, polynomial(r, c), -r);
    const F scale = as_float((as_uint(shifted) + U(127u)) << 23);
    return select(x > F(largest), F(0.f), value * scale);
}

// e^-x I0(x) for x >= 0, the modified Bessel function of the first kind. M. Abramowitz, I. A.
// Stegun, "Handbook of Mathematical Functions", 9.8.1 and 9.8.2. At most 8.5 ulp.
template <class F>
VR_HD F scaled_bessel(F x) {
    constexpr float small[] = {1.f,        3.5156229f, 3.0899424f, 1.2067492f,
                               0.2659732f, 0.0360768f, 0.0045813f};
    constexpr float large[] = {0.39894228f,  0.01328592f, 0.00225319f,  -0.00157565f, 0.00916281f,
                               -0.02057706f, 0.02635537f, -0.01647633f, 0.00392377f};
    const F t = x * F(1.f / 3.75f), over = F(1.f) / max(t, F(1.f));
    return select(t <= F(1.f), polynomial(t * t, small) * exp_minus(x),
                  polynomial(over, large) / sqrt(max(x, F(3.75f))));
}

// The angle of (x, y) in [-pi, pi], radians; 0 at the origin, odd in y.
// Computed as the arc tangent of the smaller over the larger. At most 1.5 ulp. The polynomial's
// relative error is 2.7e-9.
template <class F>
VR_ONCE F angle(F x, F y) {
    constexpr float c[] = {-0x1.55553ep-2f, 0x1.9991e4p-3f,  -0x1.242086p-3f,
                           0x1.c08c48p-4f,  -0x1.5808c4p-4f, 0x1.da272ep-5f,
                           -0x1.fd73aep-6f, 0x1.641384p-7f,  -0x1.d32e8ap-10f};
    constexpr float half_pi = 0x1.921fb6p+0f, half_pi_low = -0x1.777a5cp-25f;
    const F ax = abs(x), ay = abs(y), zero(0.f);
    const auto steep = ax < ay, back = x < zero;
    const F larger = select(steep, ay, ax);
    const F t = select(steep, ax, ay) / select(larger > zero, larger, F(1.f)), t2 = t * t;
    const F first = fma(t * t2, polynomial(t2, c), t);
    const F rest = select((steep & back) | !(steep | back), first, -first);
    const F quarters = select(steep, F(1.f), select(back, F(2.f), zero));
    const F turned = fma(quarters, F(half_pi), fma(quarters, F(half_pi_low), rest));
    return as_float(as_uint(turned) | (as_uint(y) & as_uint(F(-0.f))));
}

}  // namespace veriray
