// The small mirrors of a principled surface's coat: Burley's distribution of exponent 1, drawn as
// it is. B. Burley, "Physically-Based Shading at Disney", SIGGRAPH 2012, appendix B.
#pragma once

#include "core/mapping.h"

namespace veriray {

template <class F>
VR_HD F mix(F a, F b, F t) {
    return fma(t, b, fma(-t, a, a));
}

// gloss: from slopes of 0.1 to 0.001. Directions are local: n = +z.
template <class F>
struct ClearCoat {
    static VR_HD F squared(F gloss) {
        const F a = mix(F(0.1f), F(0.001f), gloss);
        return a * a;
    }
    static VR_HD F density(F gloss, Vec3<F> m) {
        const F a2 = squared(gloss), spread = fma(a2 * m.z, m.z, fma(m.x, m.x, m.y * m.y));
        return (a2 - F(1.f)) * F(kInvPi) / (log(a2) * spread);
    }
    static VR_HD Vec3<F> draw(F gloss, F u, F v) {
        const F a2 = squared(gloss), q = exp_minus(log(a2) * (u - F(1.f)));
        const F per = F(1.f) / (F(1.f) - a2), r = sqrt(max((q - a2) * per, F(0.f)));
        F sine, cosine;
        sincos_2pi(v, sine, cosine);
        return {r * cosine, r * sine, sqrt(max((F(1.f) - q) * per, F(0.f)))};
    }
    // Smith's G1 for GGX of slope 1/4.
    static VR_HD F seen(F c) {
        const F c2 = c * c;
        return F(2.f) * c / (c + sqrt(fma(F(0.0625f), F(1.f) - c2, c2)));
    }
};

}  // namespace veriray
