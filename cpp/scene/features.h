// The features of a scene. The mask selects the smallest compiled variant that covers them, and
// with it code, launches and memory.
#pragma once

#include <cstdint>

#include "bsdfs/closures.h"

namespace veriray {

enum Feature : uint32_t {
    kQuads = 1u << 0,     // flat parallelograms without a tree
    kPolygons = 1u << 1,  // other flat primitives without a tree
    kDisks = 1u << 2,
    kSpheres = 1u << 3,
    kBvh = 1u << 4,     // primitives in a tree
    kSmooth = 1u << 5,  // interpolated normals
    kAreaLights = 1u << 6,
    kManyLights = 1u << 7,  // more than one light to choose from
    kTriangleLights = 1u << 8,
    kDiskLights = 1u << 9,
    kSphereLights = 1u << 10,
    kDeltaLights = 1u << 11,  // point, spot, directional
    kEnvironment = 1u << 12,
    kClip = 1u << 13,  // near or far clipping that can cut something
    kLens = 1u << 14,
    kSignedFilter = 1u << 15,  // a filter with negative lobes
    kRefraction = 1u << 16,    // a material that changes the direction of transmitted light
    kPass = 1u << 17,          // a mask, or a material that lets light straight through
    kMedia = 1u << 18,
    kChromatic = 1u << 19,        // a medium whose extinction depends on the channel
    kRectangleLights = 1u << 20,  // lights near to what they light: sampled by solid angle
    kFirstMaterial = 1u << 21,    // a bit for each kind of material, in their order
    kAllFeatures = kFirstMaterial * kAllKinds | (kFirstMaterial - 1u),
};
inline constexpr uint32_t kOtherFeatures = 21, kFeatureCount = kOtherFeatures + kMaterialCount;
static_assert(kFeatureCount <= 32);

constexpr uint32_t materials(uint32_t kinds) { return kFirstMaterial * kinds; }
constexpr uint32_t kinds_of(uint32_t features) { return features / kFirstMaterial; }

inline constexpr const char* kFeatureNames[] = {
    "quads",         "polygons",      "disks",
    "spheres",       "bvh",           "smooth",
    "area_lights",   "many_lights",   "triangle_lights",
    "disk_lights",   "sphere_lights", "delta_lights",
    "environment",   "clip",          "lens",
    "signed_filter", "refraction",    "pass",
    "media",         "chromatic",     "rectangle_lights"};
constexpr const char* feature_name(uint32_t bit) {
    return bit < kOtherFeatures ? kFeatureNames[bit] : kClosures[bit - kOtherFeatures].name;
}

// With these features, rays may leave a plane by a bound that depends on their point.
inline constexpr uint32_t kLocalOffsets =
    kBvh | kDisks | kDeltaLights | kRefraction | kPass | kMedia;
inline constexpr uint32_t kPlainMaterials = materials(kPlainKinds);
inline constexpr uint32_t kSolid = kAllFeatures & ~(kPass | materials(kPassing));
inline constexpr uint32_t kAnyLight = kAreaLights | kDeltaLights;  // lights that are sampled
inline constexpr uint32_t kDiffuseFlat = kQuads | kPolygons | kAreaLights | kManyLights |
                                         kTriangleLights | kRectangleLights | kEnvironment | kClip |
                                         kPlainMaterials;
inline constexpr uint32_t kDiffuseMesh = kBvh | kSmooth | kAreaLights | kManyLights |
                                         kTriangleLights | kEnvironment | kClip | kPlainMaterials;

// Compiled variants, smallest first; the last holds everything.
inline constexpr uint32_t kVariants[] = {
    kQuads | kAreaLights | kPlainMaterials,
    kDiffuseFlat,
    kDiffuseMesh,
    kDiffuseMesh | kRectangleLights,
    kSolid & ~(kBvh | kSmooth | kMedia | kChromatic),
    kSolid & ~(kMedia | kChromatic),
    kSpheres | kEnvironment | kMedia | kRefraction | materials(kRefracting),
    kAllFeatures & ~(kBvh | kSmooth | kMedia | kChromatic),
    kAllFeatures & ~(kMedia | kChromatic),
    kAllFeatures,
};
inline constexpr uint32_t kVariantCount = 10;  // CMakeLists.txt reads it
static_assert(sizeof(kVariants) == sizeof(uint32_t) * kVariantCount);

constexpr uint32_t variant_for(uint32_t features) {
    for (uint32_t i = 0; i < kVariantCount; ++i)
        if ((features & ~kVariants[i]) == 0) return i;
    return kVariantCount - 1;
}

}  // namespace veriray
