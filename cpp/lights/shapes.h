// The shapes of lights. A new one is a file, its include here and its name in the list. Those that
// no ray meets come in the order of the scene's `light_kind`; those of one feature stand together.
#pragma once

#include <string_view>

#include "lights/constant_sky.h"
#include "lights/directional.h"
#include "lights/disk.h"
#include "lights/guided_sky.h"
#include "lights/parallelogram.h"
#include "lights/point.h"
#include "lights/projector.h"
#include "lights/rectangle.h"
#include "lights/sphere.h"
#include "lights/spot.h"
#include "lights/triangle.h"
#include "lights/triangle_pair.h"

#define VR_LIGHTS(X)      \
    X(ParallelogramLight) \
    X(TriangleLight)      \
    X(TrianglePairLight)  \
    X(DiskLight)          \
    X(SphereLight)        \
    X(PointLight)         \
    X(SpotLight)          \
    X(DirectionalLight)   \
    X(RectangleLight)     \
    X(ConstantSky)        \
    X(ImageSky)           \
    X(GuidedSky)          \
    X(ProjectorLight)

namespace veriray {

enum LightShapeId : uint32_t {
#define VR_ID_OF(name) k##name,
    VR_LIGHTS(VR_ID_OF)
#undef VR_ID_OF
        kLightShapes,
};
constexpr uint32_t shape_bit(uint32_t shape) { return 1u << shape; }
inline constexpr uint32_t kAllShapes = (1u << kLightShapes) - 1u;

// What a shape is, for the host and for the choice of code. power and write: see LightShape.
struct LightTraits {
    const char *name, *feature;
    LightSite site;
    bool sampled, flat, spreads, by_angle, paired, own_pdf, round, skips, aimed, cone, image,
        framed;
};
inline constexpr LightTraits kLights[] = {
#define VR_TRAITS_OF(T)                                                                 \
    {T<Scalar>::kName,   T<Scalar>::kFeature, T<Scalar>::kSite,    T<Scalar>::kSampled, \
     T<Scalar>::kFlat,   T<Scalar>::kSpreads, T<Scalar>::kByAngle, T<Scalar>::kPaired,  \
     T<Scalar>::kOwnPdf, T<Scalar>::kRound,   T<Scalar>::kSkips,   T<Scalar>::kAimed,   \
     T<Scalar>::kCone,   T<Scalar>::kImage,   T<Scalar>::kFramed},
    VR_LIGHTS(VR_TRAITS_OF)
#undef VR_TRAITS_OF
};

// The shapes for which `trait` holds.
template <class Trait>
constexpr uint32_t shapes_with(Trait trait) {
    uint32_t shapes = 0;
    for (uint32_t k = 0; k < kLightShapes; ++k)
        if (trait(kLights[k])) shapes |= shape_bit(k);
    return shapes;
}
inline constexpr uint32_t kLampShapes = shapes_with([](auto& s) { return s.site == kOnSurface; });
inline constexpr uint32_t kPointShapes = shapes_with([](auto& s) { return s.site == kAtPoint; });
inline constexpr uint32_t kSkyShapes = shapes_with([](auto& s) { return s.site == kAllAround; });
inline constexpr uint32_t kDeltaShapes = kAllShapes & ~(kLampShapes | kSkyShapes);
inline constexpr uint32_t kSampledShapes = shapes_with([](auto& s) { return s.sampled; });
inline constexpr uint32_t kFlatShapes = shapes_with([](auto& s) { return s.flat; });
inline constexpr uint32_t kSpreadShapes = shapes_with([](auto& s) { return s.spreads; });
inline constexpr uint32_t kByAngleShapes = shapes_with([](auto& s) { return s.by_angle; });
inline constexpr uint32_t kPairedShapes = shapes_with([](auto& s) { return s.paired; });
inline constexpr uint32_t kOwnPdfShapes = shapes_with([](auto& s) { return s.own_pdf; });
inline constexpr uint32_t kRoundShapes = shapes_with([](auto& s) { return s.round; });
inline constexpr uint32_t kSkippedShapes = shapes_with([](auto& s) { return s.skips; });
inline constexpr uint32_t kConeShapes = shapes_with([](auto& s) { return s.cone; });
inline constexpr uint32_t kImageShapes = shapes_with([](auto& s) { return s.image; });
// Scenes of these alone have code of their own: the lamps of most scenes, those of meshes, those
// that are near to something.
inline constexpr uint32_t kPlainShapes = shape_bit(kParallelogramLight);
inline constexpr uint32_t kMeshShapes = kPlainShapes | shape_bit(kTriangleLight);
inline constexpr uint32_t kNearShapes = shape_bit(kRectangleLight);
// Scenes without these do not pay for their code.
inline constexpr uint32_t kRichShapes =
    shape_bit(kImageSky) | shape_bit(kGuidedSky) | shape_bit(kProjectorLight);

// Features of scenes: the place of a shape's in the order of the list; how many there are.
constexpr uint32_t light_feature(uint32_t shape) {
    uint32_t place = 0;
    for (uint32_t k = 1; k <= shape; ++k)
        place += std::string_view(kLights[k].feature) != kLights[k - 1].feature;
    return place;
}
inline constexpr uint32_t kLightFeatures = light_feature(kLightShapes - 1u) + 1u;
constexpr const char* light_feature_name(uint32_t place) {
    uint32_t k = 0;
    while (light_feature(k) != place) ++k;
    return kLights[k].feature;
}

// The shape of the scene's lights of a `light_kind`.
constexpr uint32_t shape_of_kind(uint32_t kind) {
    uint32_t k = 0;
    while (!(kDeltaShapes >> k & 1u) || kind--) ++k;
    return k;
}

// Calls visit(shape) for the source's; the host's way to power and write.
template <class Visit>
VR_HD void with_shape(uint32_t shape, Visit visit) {
#define VR_VISIT(T) \
    if (shape == k##T) visit(T<Scalar>());
    VR_LIGHTS(VR_VISIT)
#undef VR_VISIT
}

}  // namespace veriray
