// What a scene has. The mask picks the smallest compiled variant that covers it, and with it code,
// launches and memory.
#pragma once

#include <cstdint>

namespace veriray {

enum Feature : uint32_t {
    kQuads = 1u << 0,     // flat parallelograms without a tree
    kPolygons = 1u << 1,  // other flat primitives without a tree
    kBvh = 1u << 2,       // triangles in a tree
    kAreaLights = 1u << 3,
    kManyLights = 1u << 4,  // more than one emitting primitive
    kTriangleLights = 1u << 5,
    kEnvironment = 1u << 6,
    kClip = 1u << 7,  // near or far clipping that can cut something
    kAllFeatures = (1u << 8) - 1,
};

inline constexpr const char* kFeatureNames[] = {"quads",       "polygons",    "bvh",
                                                "area_lights", "many_lights", "triangle_lights",
                                                "environment", "clip"};
inline constexpr uint32_t kFeatureCount = 8;

// Compiled variants, smallest first; the last holds everything.
inline constexpr uint32_t kVariants[] = {
    kQuads | kAreaLights,
    kQuads | kPolygons | kAreaLights | kManyLights | kTriangleLights | kEnvironment | kClip,
    kAllFeatures,
};
inline constexpr uint32_t kVariantCount = 3;

constexpr uint32_t variant_for(uint32_t features) {
    for (uint32_t i = 0; i < kVariantCount; ++i)
        if ((features & ~kVariants[i]) == 0) return i;
    return kVariantCount - 1;
}

}  // namespace veriray
