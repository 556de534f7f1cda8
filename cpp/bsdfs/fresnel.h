// Fresnel's equations for unpolarised light, by cosines. M. Born, E. Wolf, "Principles of Optics",
// chapters 1.5 and 14.2.
#pragma once

#include "core/math.h"
#include "core/vec.h"

namespace veriray {

template <class F>
struct FresnelSplit {
    F reflected;  // 1 under total reflection
    F cos_t;      // of the refracted direction, positive; 0 under total reflection
};

// cos_i in [0, 1] on the side the light comes from; eta: index beyond over index here.
template <class F>
VR_HD FresnelSplit<F> fresnel_dielectric(F cos_i, F eta) {
    const F sin2_t = fma(-cos_i, cos_i, F(1.f)) / (eta * eta);
    const auto total = sin2_t >= F(1.f);
    const F cos_t = sqrt(max(F(1.f) - sin2_t, F(0.f)));
    const F s = fma(-eta, cos_t, cos_i) / fma(eta, cos_t, cos_i);
    const F p = fma(eta, cos_i, -cos_t) / fma(eta, cos_i, cos_t);
    const F r = select(eta == F(1.f), F(0.f), F(0.5f) * fma(s, s, p * p));
    return {select(total & !(eta == F(1.f)), F(1.f), r), cos_t};
}

// The same of a small mirror, from the cosines to it on wo's side and on wi's. Of light that goes
// through it by the one in the thinner medium: beside total reflection the last bits of the other
// would count.
template <class F, class M>
VR_HD FresnelSplit<F> fresnel_of_mirror(F here, F there, F eta, M through) {
    const M turn = through & (eta < F(1.f));
    const F c = min(abs(select(turn, there, here)), F(1.f));
    return fresnel_dielectric(c, select(turn, F(1.f) / eta, eta));
}

// Reflectance of a conductor of complex index eta + ik, one channel.
template <class F>
VR_ONCE F fresnel_conductor(F cos_i, F eta, F k) {
    const F c2 = cos_i * cos_i, s2 = F(1.f) - c2;
    const F e2 = eta * eta, k2 = k * k;
    const F d = e2 - k2 - s2;
    const F ab = sqrt(fma(d, d, F(4.f) * e2 * k2));  // a^2 + b^2
    // a^2 = (ab + d) / 2 = 2 e2 k2 / (ab - d): the form that does not cancel
    const F a =
        sqrt(select(d > F(0.f), F(0.5f) * (ab + d), F(2.f) * e2 * k2 / max(ab - d, F(1e-30f))));
    const F t = F(2.f) * a * cos_i;
    // b^2 + (a - cos)^2, which rounding may leave below 0
    const F apart = ab + c2 - t;
    const F s = select(apart < F(0.f), F(0.f), apart) / (ab + c2 + t);
    const F u = fma(c2, ab, s2 * s2), v = t * s2;
    // u = v = 0: an index of 0 at normal incidence reflects everything.
    const F p = select(u + v > F(0.f), (u - v) / (u + v), F(1.f));
    return F(0.5f) * s * (F(1.f) + p);
}

// Directions of the mirror and of refraction about n; wo and n on the same side.
template <class F>
VR_HD Vec3<F> reflected(Vec3<F> wo, Vec3<F> n, F cos_o) {
    return renormalised(fma(n, F(2.f) * cos_o, -wo));
}
template <class F>
VR_HD Vec3<F> refracted(Vec3<F> wo, Vec3<F> n, F cos_o, F cos_t, F eta) {
    const F ratio = F(1.f) / eta;
    return renormalised(fma(n, fma(ratio, cos_o, -cos_t), wo * -ratio));
}

}  // namespace veriray
