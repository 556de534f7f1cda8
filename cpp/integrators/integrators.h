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

// The integrator of an index of the list: IntegratorAt<index>::Tracer<lane type, features>.
#define VR_INDEX(name, type) kIntegrator_##name,
enum IntegratorIndex : uint32_t { VR_INTEGRATORS(VR_INDEX) };
#undef VR_INDEX
template <uint32_t kIndex>
struct IntegratorAt;
#define VR_AT(name, type)                     \
    template <>                               \
    struct IntegratorAt<kIntegrator_##name> { \
        template <class L, FeatureMask kMask> \
        using Tracer = type<L, kMask>;        \
    };
VR_INTEGRATORS(VR_AT)
#undef VR_AT

// Calls fn.template operator()<Variant>() with that integrator's variant.
template <uint32_t kIndex, class Fn>
void with_integrator(uint32_t integrator, Fn&& fn) {
    uint32_t at = 0;
#define VR_CALL(name, type) \
    if (integrator == at++) fn.template operator()<Variant<type, kVariants[kIndex]>>();
    VR_INTEGRATORS(VR_CALL)
#undef VR_CALL
}
// kOf: a bit for each variant that is compiled; index is one of them.
template <uint32_t kOf = kEveryVariant, uint32_t kIndex = 0, class Fn>
void with_variant(uint32_t integrator, uint32_t index, Fn&& fn) {
    if constexpr (kIndex < kVariantCount) {
        if constexpr ((kOf >> kIndex & 1u) != 0)
            if (index == kIndex) return with_integrator<kIndex>(integrator, fn);
        with_variant<kOf, kIndex + 1>(integrator, index, fn);
    }
}

}  // namespace veriray
