// The integrators, and what is compiled of each.
#pragma once

#include "integrators/path.h"
#include "scene/variants.h"

// (name, template)
#define VR_INTEGRATORS(INTEGRATOR) INTEGRATOR(path, PathTracer)

namespace veriray {

// An integrator compiled for a set of features.
template <template <class, FeatureMask> class T, FeatureMask kMask>
struct Variant {
    template <class L>
    using Tracer = T<L, kMask>;
};

#define VR_NAME(name, type) #name,
inline constexpr const char* kIntegrators[] = {VR_INTEGRATORS(VR_NAME)};
#undef VR_NAME
inline constexpr uint32_t kIntegratorCount = sizeof(kIntegrators) / sizeof(kIntegrators[0]);

// Calls fn.template operator()<Variant>() with that integrator's variant.
template <uint32_t kIndex, class Fn>
void with_integrator(uint32_t integrator, Fn&& fn) {
    uint32_t at = 0;
#define VR_CALL(name, type) \
    if (integrator == at++) fn.template operator()<Variant<type, kVariants[kIndex]>>();
    VR_INTEGRATORS(VR_CALL)
#undef VR_CALL
}
template <uint32_t kIndex = 0, class Fn>
void with_variant(uint32_t integrator, uint32_t index, Fn&& fn) {
    if constexpr (kIndex < kVariantCount) {
        if (index == kIndex)
            with_integrator<kIndex>(integrator, fn);
        else
            with_variant<kIndex + 1>(integrator, index, fn);
    }
}

}  // namespace veriray
