// Light that the mirrors of a rough surface send on to each other, or shadow, is lost to a closure
// of single steps. Lobes give it back: C. Kulla, A. Conty, "Revisiting Physically Based Shading at
// Imageworks", SIGGRAPH 2017. lost(c) is 1 less what the mirrors send on of light at a cosine c if
// they absorb nothing; f = lost(c_o) lost(c_i) / (pi mean) sends on just lost(c_o), whatever the
// table of `lost` holds, as its mean is that of the table.
#pragma once

#include "bsdfs/microfacet.h"

namespace veriray {

template <class L>
struct LostLight : Closure<L> {
    VR_CLOSURE(L);
    using U = typename L::U;

    // first: column of the cosine 0. Linear in a / (a + b), a and b the roots of the cosine and of
    // alpha times the sine, by whose ratio shadows differ.
    static VR_HD F lost(const Parameters& p, const View& view, F cosine, U first) {
        if (!view.table.columns) return F(0.f);
        const F c = min(cosine, F(1.f)), sine = sqrt(fma(-c, c, F(1.f)));
        const F a = sqrt(c), b = sqrt(p.alpha_u * sine);
        const F x = a / (a + b) * F(float{kLostCells});
        const U cell = to_uint(min(x, F(kLostCells - 1.f)));
        return view.table.between(cell + first, x - to_float(cell));
    }

    // Directions of the lobes: a density in proportion to c / (c^2 + w^2), about as is lost there,
    // whose ratio to it is bounded for all alpha.
    static VR_HD F pdf_sa(const Parameters& p, F cosine) {
        const F w2 = squared_width(p);
        return cosine_hemisphere_pdf_sa(cosine) / (fma(cosine, cosine, w2) * span(w2));
    }
    static VR_HD V direction(const Parameters& p, const View& view, F u, F v, F& cosine) {
        const F w2 = squared_width(p), none(0.f);
        const F c2 = max(fma(F(1.f) + w2, exp_minus(u * span(w2)), -w2), none);
        const F sine = sqrt(max(F(1.f) - c2, none));
        F s, c;
        sincos_2pi(v, s, c);
        V a, b;
        orthonormal_frame(view.n, a, b);
        cosine = sqrt(c2);
        return fma(a, sine * c, fma(b, sine * s, view.n * cosine));
    }

   private:
    static VR_HD F squared_width(const Parameters& p) {
        const F w = min(p.alpha_u, F(1.f));
        return w * w;
    }
    static VR_HD F span(F w2) { return log(F(1.f) + F(1.f) / w2); }
};

}  // namespace veriray
