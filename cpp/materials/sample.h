// What a material says of a pair of directions, and of one that it has chosen.
#pragma once

#include "core/vec.h"
#include "spectrum/spectrum.h"

namespace veriray {

template <class F>
struct BsdfValue {
    Spectrum<F> f_cos;  // f(wo, wi) |cos wi|
    F pdf_sa;           // of the smooth lobe, its choice included
};

template <class L>
struct BsdfSample {
    Vec3<typename L::F> wi;          // unit, world
    Spectrum<typename L::F> weight;  // f |cos| / pdf
    typename L::F pdf_sa;            // 0 for a delta lobe
    typename L::M transmitted;       // wi lies behind the surface
    typename L::M pass;              // straight through
};

}  // namespace veriray
