// What is left of light on a surface whose normals a texture turns.
#pragma once

#include "core/vec.h"

namespace veriray {

// Light counts on the same sides of view.n and of the surface's own normal alone, and grazing light
// less (A. Conty Estevez, P. Lecocq, C. Stein 2019, "A Microfacet-Based Shadowing Function to Solve
// the Bump Terminator Problem").
template <class L>
struct Relief {
    using F = typename L::F;
    using M = typename L::M;
    using V = Vec3<F>;

    bool some = false;  // lanes may have one
    M lanes;
    V n;    // the surface's own normal, on wo's side
    F low;  // squared slope of the shadows

    // What is left of light from wi; cosine: between wi and view.n.
    VR_HD F lit(V wi, F cosine) const {
        const F c = dot(n, wi), c2 = c * c, s2 = max(F(1.f) - c2, F(0.f));
        const F left = F(2.f) * abs(c) / (abs(c) + sqrt(fma(low, s2, c2)));
        const M both = ((c > F(0.f)) & (cosine > F(0.f))) | ((c < F(0.f)) & (cosine < F(0.f)));
        return select(lanes, select(both, left, F(0.f)), F(1.f));
    }
};

}  // namespace veriray
