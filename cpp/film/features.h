// Feature images as planes of a film: their names, channels and scales, and what stages need to
// know.
#pragma once

#include <cstdint>

namespace veriray {

// The feature images that are means, and how a film holds their samples.
enum FeatureKind : uint32_t {
    kDepthFeature,      // along the ray, from the camera or its lens
    kDepthAxisFeature,  // along the camera's axis
    kPositionFeature,
    kNormalFeature,     // of shading, as the surface's front has it
    kGeoNormalFeature,  // of the surface's front
    kAlbedoFeature,     // share of light towards the camera that goes on
    kUvFeature,
    kMotionFeature,  // of the point's image, in pixels, from one camera to another
    kFeatureKinds,
};
// What a feature's numbers are: of no unit, a length, which is infinite where nothing is met, or a
// point's coordinates.
enum class FeatureUnit : uint32_t { kNone, kLength, kPoint };
struct FeatureInfo {
    const char* name;
    uint32_t channels;
    float scale;  // as of a film's plane; lengths are normalised ones
    FeatureUnit unit = FeatureUnit::kNone;
};
inline constexpr FeatureInfo kFeatureInfos[kFeatureKinds] = {
    {"depth", 1, 1.f, FeatureUnit::kLength},
    {"depth_axis", 1, 1.f, FeatureUnit::kLength},
    {"position", 3, 1.f, FeatureUnit::kPoint},
    {"normal", 3, 1.f},
    {"geo_normal", 3, 1.f},
    {"albedo", 3, 1.f},
    {"uv", 2, 0x1p-12f},
    {"motion", 2, 0x1p-12f},
};
inline constexpr uint32_t kMostFeatureChannels = 18;
// Planes of integers: samples that met a surface; what the ray through the pixel's centre meets, 1
// + the primitive, 0 for nothing.
inline constexpr const char *kHitsPlane = "hits", *kPrimitivePlane = "primitive";

// What the stages have to know. A row {g, w} is g.p + w of a normalised point p.
struct FeatureView {
    uint32_t wanted;        // a bit for each FeatureKind
    float axis[4];          // depth along the axis
    float motion[2][3][4];  // x, y and w of the pixel under which each camera has a point
};

}  // namespace veriray
