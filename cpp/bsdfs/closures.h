// The closures, in the order of the scene's `material_kind`. A new one is a file, its include here
// and its name in the list.
#pragma once

#include "bsdfs/conductor.h"
#include "bsdfs/dielectric.h"
#include "bsdfs/diffuse.h"
#include "bsdfs/null.h"
#include "bsdfs/plastic.h"
#include "bsdfs/thin_dielectric.h"

#define VR_CLOSURES(X) X(Diffuse) X(Conductor) X(Dielectric) X(Plastic) X(ThinDielectric) X(Null)

namespace veriray {

enum MaterialKind : uint32_t {
#define VR_KIND_OF(name) kKind##name,
    VR_CLOSURES(VR_KIND_OF)
#undef VR_KIND_OF
        kMaterialCount,
};
constexpr uint32_t kind_bit(MaterialKind k) { return 1u << k; }
inline constexpr uint32_t kAllKinds = (1u << kMaterialCount) - 1u;

// Properties of a kind of material, for the host and for the selection of code.
struct ClosureTraits {
    const char* name;
    uint32_t reads;
    bool scatters, clear, refracts, passes, reflects, indexed;
};
inline constexpr ClosureTraits kClosures[] = {
#define VR_TRAITS_OF(C)                                                                 \
    {C<Scalar>::kName,     C<Scalar>::kReads,  C<Scalar>::kScatters, C<Scalar>::kClear, \
     C<Scalar>::kRefracts, C<Scalar>::kPasses, C<Scalar>::kReflects, C<Scalar>::kIndexed},
    VR_CLOSURES(VR_TRAITS_OF)
#undef VR_TRAITS_OF
};

// The set that holds one kind.
constexpr uint32_t only_kind(uint32_t kinds) {
    uint32_t k = 0;
    while (kinds >> k > 1u) ++k;
    return k;
}
// The kinds for which `trait` holds.
template <class Trait>
constexpr uint32_t kinds_with(Trait trait) {
    uint32_t kinds = 0;
    for (uint32_t k = 0; k < kMaterialCount; ++k)
        if (trait(kClosures[k])) kinds |= 1u << k;
    return kinds;
}
inline constexpr uint32_t kScattering = kinds_with([](auto& c) { return c.scatters; });
inline constexpr uint32_t kClearKinds = kinds_with([](auto& c) { return c.clear; });
inline constexpr uint32_t kRefracting = kinds_with([](auto& c) { return c.refracts; });
inline constexpr uint32_t kPassing = kinds_with([](auto& c) { return c.passes; });
inline constexpr uint32_t kReflecting = kinds_with([](auto& c) { return c.reflects; });
inline constexpr uint32_t kIndexedKinds = kinds_with([](auto& c) { return c.indexed; });
// The most frequent kind: scenes with this kind alone have code of their own.
inline constexpr uint32_t kPlainKinds = kind_bit(kKindDiffuse);
// Kinds whose eta may be 0, and kinds whose reflectance is that of a base within a coat.
inline constexpr uint32_t kMetalKinds = kind_bit(kKindConductor);
inline constexpr uint32_t kCoatedKinds = kind_bit(kKindPlastic);

}  // namespace veriray
