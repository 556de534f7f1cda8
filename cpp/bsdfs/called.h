// On the host, rough closures are called, not inlined, and compiled once for each instruction set
// (called.cpp) instead of once in each compiled variant.
#pragma once

#include "bsdfs/closures.h"

namespace veriray {

#if VR_CUDA
template <class C>
using CalledClosure = C;
#else
template <class C>
struct CalledClosure : C {
    using V = typename C::V;
    using F = typename C::F;

    static typename C::Value eval(const typename C::Parameters& p, const typename C::View& view,
                                  const V& wo, const V& wi, const F& cos_i);
    static typename C::Sample sample(const typename C::Parameters& p, const typename C::View& view,
                                     const V& wo, const typename C::Numbers& r,
                                     const typename C::M& nobody);
};
#endif

// The form in which Bsdf uses a closure.
template <uint32_t kKind, class C>
using UsedClosure = std::conditional_t<(kRoughKinds >> kKind & 1u) != 0, CalledClosure<C>, C>;

}  // namespace veriray
