// The compiled variants, each for a set of features.
#pragma once

#include "bsdfs/closures.h"
#include "scene/features.h"

namespace veriray {

inline constexpr FeatureMask kPlainMaterials = materials(kPlainKinds);
// Features that the variants of scenes without any of them are compiled without, so that these
// scenes do not pay for them.
inline constexpr FeatureMask kRich = kTextures | kLightTextures | kHidden | kAlbedoGrids |
                                     kUnevenMedia | kPhases | kBlend | kAttributes | kTangents |
                                     materials(kRoughKinds) | lights(kRichShapes);
inline constexpr FeatureMask kLean = kAllFeatures & ~kRich;
inline constexpr FeatureMask kSolid = kLean & ~(kPass | materials(kPassing));
inline constexpr FeatureMask kMeshLights = lights(kMeshShapes), kNearLights = lights(kNearShapes),
                             kLeanSky = kSky & kLean;
inline constexpr FeatureMask kDiffuseFlat = kQuads | kPolygons | kMeshLights | kManyLights |
                                            kNearLights | kLeanSky | kClip | kPlainMaterials;
inline constexpr FeatureMask kDiffuseMesh =
    kBvh | kSmooth | kMeshLights | kManyLights | kLeanSky | kClip | kPlainMaterials;

// Compiled variants, smallest first; the last holds everything.
inline constexpr FeatureMask kVariants[] = {
#ifndef VERIRAY_ONE_VARIANT
    kQuads | lights(kPlainShapes) | kPlainMaterials,
    kDiffuseFlat | kTextures,
    kDiffuseMesh,
    kDiffuseMesh | kNearLights,
    kSolid & ~(kBvh | kSmooth | kMedia | kChromatic),
    kLean & ~(kBvh | kSmooth | kMedia | kChromatic),
    kLean & ~(kMedia | kChromatic),
    kAllFeatures & ~(kMedia | kChromatic | kAlbedoGrids | kUnevenMedia | kPhases),
    kLean,
#endif
    kAllFeatures,
};
static_assert(sizeof(kVariants) == sizeof(FeatureMask) * kVariantCount);

// A bit for each that is compiled of schedulers that are not the default one: the smallest, that of
// scenes without rich features, and the one for everything.
#ifndef VERIRAY_ONE_VARIANT
inline constexpr uint32_t kFewVariants = 1u | 1u << 8 | 1u << 9;
static_assert(kVariants[8] == kLean && kVariants[9] == kAllFeatures);
#else
inline constexpr uint32_t kFewVariants = 1u;
#endif

// The smallest of those that covers the features.
constexpr uint32_t variant_for(FeatureMask features, uint32_t of = kEveryVariant) {
    for (uint32_t i = 0; i < kVariantCount; ++i)
        if ((of >> i & 1u) && (features & ~kVariants[i]) == 0) return i;
    return kVariantCount - 1;
}

}  // namespace veriray
