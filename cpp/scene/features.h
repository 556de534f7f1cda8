// The features of a scene. The mask selects the smallest compiled variant that covers them
// (scene/variants.h), and with it code, launches and memory.
#pragma once

#include <cstdint>

#include "bsdfs/kinds.h"
#include "lights/shapes.h"

namespace veriray {

using FeatureMask = uint64_t;

enum Feature : FeatureMask {
    kQuads = 1u << 0,     // flat parallelograms without a tree
    kPolygons = 1u << 1,  // other flat primitives without a tree
    kDisks = 1u << 2,
    kSpheres = 1u << 3,
    kBvh = 1u << 4,         // primitives in a tree
    kSmooth = 1u << 5,      // shading normals: interpolated, or turned by textures
    kManyLights = 1u << 6,  // more than one light to choose from
    kClip = 1u << 7,        // near or far clipping that can cut something
    kLens = 1u << 8,
    kRefraction = 1u << 9,  // a material that changes the direction of what goes through
    kPass = 1u << 10,       // a mask, or a material that lets light straight through
    kMedia = 1u << 11,
    kChromatic = 1u << 12,      // a medium whose extinction depends on the channel
    kTextures = 1u << 13,       // textures on surfaces
    kAlbedoGrids = 1u << 14,    // a medium whose albedo a grid gives
    kUnevenMedia = 1u << 15,    // a medium whose extinction a grid gives
    kBlend = 1u << 16,          // a material that is several in one
    kAttributes = 1u << 17,     // a texture of numbers that meshes have, or one in another
    kTangents = 1u << 18,       // slopes that depend on the direction, normal and bump maps
    kHidden = 1u << 19,         // light that the camera does not see directly
    kLightTextures = 1u << 20,  // textures of lights
    kPhases = 1u << 21,         // a phase function that is not Henyey and Greenstein's alone
    kFirstLight = 1u << 22,     // a bit for each feature of lights, in their order
    kFirstMaterial = kFirstLight << kLightFeatures,  // for each kind of material, in their order
    kAllFeatures = kFirstMaterial * kAllKinds | (kFirstMaterial - 1u),
};
inline constexpr const char* kFeatureNames[] = {
    "quads",       "polygons", "disks",          "spheres",      "bvh",   "smooth",
    "many_lights", "clip",     "lens",           "refraction",   "pass",  "media",
    "chromatic",   "textures", "albedo_grids",   "uneven_media", "blend", "attributes",
    "tangents",    "hidden",   "light_textures", "phases"};
inline constexpr uint32_t kOtherFeatures = sizeof(kFeatureNames) / sizeof(kFeatureNames[0]),
                          kFeatureCount = kOtherFeatures + kLightFeatures + kMaterialCount;
static_assert(kFirstLight == 1u << kOtherFeatures && kFeatureCount <= 64);

constexpr FeatureMask only_if(bool holds, FeatureMask features) { return holds ? features : 0; }
constexpr FeatureMask materials(uint32_t kinds) { return FeatureMask{kFirstMaterial} * kinds; }
constexpr uint32_t kinds_of(FeatureMask features) {
    return static_cast<uint32_t>(features / kFirstMaterial);
}
constexpr FeatureMask lights(uint32_t shapes) {
    FeatureMask features = 0;
    for (uint32_t k = 0; k < kLightShapes; ++k)
        if (shapes >> k & 1u) features |= FeatureMask{kFirstLight} << light_feature(k);
    return features;
}
constexpr uint32_t shapes_of(FeatureMask features) {
    uint32_t shapes = 0;
    for (uint32_t k = 0; k < kLightShapes; ++k)
        if (features & lights(shape_bit(k))) shapes |= shape_bit(k);
    return shapes;
}

inline const char* feature_name(uint32_t bit) {
    if (bit < kOtherFeatures) return kFeatureNames[bit];
    bit -= kOtherFeatures;
    return bit < kLightFeatures ? light_feature_name(bit)
                                : closure_traits(bit - kLightFeatures).name;
}

inline constexpr FeatureMask kLamps = lights(kLampShapes), kDeltaLights = lights(kDeltaShapes),
                             kSky = lights(kSkyShapes);
inline constexpr FeatureMask kAnyLight = lights(kSampledShapes);
inline constexpr FeatureMask kOwnPdfLights = lights(kOwnPdfShapes);
inline constexpr FeatureMask kSkippedLights = lights(kSkippedShapes);

// Variants of variants.h; CMakeLists.txt reads their number. For development, VERIRAY_ONE_VARIANT
// compiles the last one alone.
#ifdef VERIRAY_ONE_VARIANT
inline constexpr uint32_t kVariantCount = 1;
#else
inline constexpr uint32_t kVariantCount = 10;
#endif

inline constexpr uint32_t kEveryVariant = (1u << kVariantCount) - 1u;  // a bit for each

// With these features, rays may leave a plane by a bound that depends on their point.
inline constexpr FeatureMask kLocalOffsets =
    kBvh | kDisks | kSpheres | kDeltaLights | kRefraction | kPass | kMedia;

}  // namespace veriray
