// A surface without an effect on light; it may bound media.
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

template <class L>
struct Null : Closure<L> {
    VR_CLOSURE(L);
    static constexpr const char* kName = "null";
    static constexpr bool kClear = true, kPasses = true, kReflects = false;
    static constexpr uint32_t kReads = 0;

    static VR_HD S albedo(const Parameters&, const View&) { return S::all(F(1.f)); }
    static VR_HD Sample sample(const Parameters&, const View&, V wo, Numbers, M nobody) {
        const M all = !nobody;
        return {-wo, S::all(F(1.f)), F(0.f), nobody, all};
    }
    static VR_HD S pass_through(const Parameters&, const View&) { return S::all(F(1.f)); }
};

}  // namespace veriray
