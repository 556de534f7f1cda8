// Rough closures are called, not inlined. On the host they are compiled once for each instruction
// set (called.cpp) instead of once in each compiled variant.
#pragma once

#include "bsdfs/closures.h"

namespace veriray {

#if VR_CUDA
template <class C>
struct CalledClosure : C {
    using V = typename C::V;

    static VR_LONG typename C::Value eval(typename C::Parameters p, typename C::View view, V wo,
                                          V wi, typename C::F cos_i) {
        return C::eval(p, view, wo, wi, cos_i);
    }
    static VR_LONG typename C::Sample sample(typename C::Parameters p, typename C::View view, V wo,
                                             typename C::Numbers r, typename C::M nobody) {
        return C::sample(p, view, wo, r, nobody);
    }
};
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
