// The kinds of material by name; the host does without their code, which bsdfs/closures.h has.
#pragma once

#include <cstdint>

#include "bsdfs/closures.def"

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
    uint32_t reads, table;
    bool scatters, clear, refracts, passes, reflects, indexed, transmits, third_number, follows,
        either_side;

    bool lets_through() const { return clear || transmits; }
};
const ClosureTraits& closure_traits(uint32_t kind);

// The most frequent kind: scenes with this kind alone have code of their own.
inline constexpr uint32_t kPlainKinds = kind_bit(kKindDiffuse);
// Kinds that make up for what their mirrors lose, kinds whose eta may be 0, and kinds whose
// reflectance is that of a base within a coat.
inline constexpr uint32_t kWholeKinds =
    kind_bit(kKindWholeConductor) | kind_bit(kKindWholeDielectric);
inline constexpr uint32_t kMetalKinds =
    kind_bit(kKindConductor) | kind_bit(kKindRoughConductor) | kind_bit(kKindWholeConductor);
inline constexpr uint32_t kCoatedKinds = kind_bit(kKindPlastic) | kind_bit(kKindRoughPlastic);
#define VR_KIND_BIT(name) | kind_bit(kKind##name)
inline constexpr uint32_t kRoughKinds = 0u VR_ROUGH_CLOSURES(VR_KIND_BIT);
#undef VR_KIND_BIT

}  // namespace veriray
