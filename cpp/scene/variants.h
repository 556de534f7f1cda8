// The compiled variants, each for a set of features.
#pragma once

#include "bsdfs/closures.h"
#include "scene/features.h"

namespace veriray {

inline constexpr uint32_t kPlainMaterials = materials(kPlainKinds);
inline constexpr uint32_t kSolid = kAllFeatures & ~(kPass | materials(kPassing));
inline constexpr uint32_t kMeshLights = lights(kMeshShapes), kNearLights = lights(kNearShapes);
inline constexpr uint32_t kDiffuseFlat =
    kQuads | kPolygons | kMeshLights | kManyLights | kNearLights | kSky | kClip | kPlainMaterials;
inline constexpr uint32_t kDiffuseMesh =
    kBvh | kSmooth | kMeshLights | kManyLights | kSky | kClip | kPlainMaterials;

// Compiled variants, smallest first; the last holds everything.
inline constexpr uint32_t kVariants[] = {
    kQuads | lights(kPlainShapes) | kPlainMaterials,
    kDiffuseFlat,
    kDiffuseMesh,
    kDiffuseMesh | kNearLights,
    kSolid & ~(kBvh | kSmooth | kMedia | kChromatic),
    kSolid & ~(kMedia | kChromatic),
    kSpheres | kSky | kMedia | kRefraction | materials(kRefracting),
    kAllFeatures & ~(kBvh | kSmooth | kMedia | kChromatic),
    kAllFeatures & ~(kMedia | kChromatic),
    kAllFeatures,
};
static_assert(sizeof(kVariants) == sizeof(uint32_t) * kVariantCount);

constexpr uint32_t variant_for(uint32_t features) {
    for (uint32_t i = 0; i < kVariantCount; ++i)
        if ((features & ~kVariants[i]) == 0) return i;
    return kVariantCount - 1;
}

}  // namespace veriray
