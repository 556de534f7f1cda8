// The code of rough closures that the compiled variants share.
#include "bsdfs/called.h"

namespace veriray {

template <class C>
typename C::Value CalledClosure<C>::eval(const typename C::Parameters& p,
                                         const typename C::View& view, const V& wo, const V& wi,
                                         const F& cos_i) {
    return C::eval(p, view, wo, wi, cos_i);
}

template <class C>
typename C::Sample CalledClosure<C>::sample(const typename C::Parameters& p,
                                            const typename C::View& view, const V& wo,
                                            const typename C::Numbers& r,
                                            const typename C::M& nobody) {
    return C::sample(p, view, wo, r, nobody);
}

#define VR_CALLED_CLOSURE(C) template struct CalledClosure<C<VR_LANES>>;
#define VR_LANES Scalar
VR_ROUGH_CLOSURES(VR_CALLED_CLOSURE)
#undef VR_LANES
#ifndef VR_ONE_LANE
#define VR_LANES Simd
VR_ROUGH_CLOSURES(VR_CALLED_CLOSURE)
#endif

}  // namespace veriray
