// The closures of closures.def, and what follows from their properties.
#pragma once

#define VR_CLOSURE_FILES
#include "bsdfs/closures.def"
#undef VR_CLOSURE_FILES
#include "bsdfs/kinds.h"

namespace veriray {

inline constexpr ClosureTraits kClosures[] = {
#define VR_TRAITS_OF(C)                                                                           \
    {C<Scalar>::kName,      C<Scalar>::kReads,     C<Scalar>::kTable,       C<Scalar>::kScatters, \
     C<Scalar>::kClear,     C<Scalar>::kRefracts,  C<Scalar>::kPasses,      C<Scalar>::kReflects, \
     C<Scalar>::kIndexed,   C<Scalar>::kTransmits, C<Scalar>::kThirdNumber, C<Scalar>::kFollows,  \
     C<Scalar>::kEitherSide},
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
inline constexpr uint32_t kTransmittingKinds = kinds_with([](auto& c) { return c.transmits; });
inline constexpr uint32_t kEitherSideKinds = kinds_with([](auto& c) { return c.either_side; });
inline constexpr uint32_t kChoosingKinds =
    kIndexedKinds | kinds_with([](auto& c) { return c.third_number; });
inline constexpr uint32_t kTables = kinds_with([](auto& c) { return c.table > 0; });

}  // namespace veriray
