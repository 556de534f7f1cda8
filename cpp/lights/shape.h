// What lights are made of. A shape of light is a type template on lanes with the members that
// LightShape names, of which it states those that differ from the defaults; shapes.h lists them
// all. What a light is, the host gives (LightSource); what the stages see of it is a row of the
// light table. Lengths are normalised.
#pragma once

#include "core/mapping.h"
#include "lights/sky_map.h"
#include "lights/source.h"
#include "lights/tree_view.h"
#include "spectrum/spectrum.h"

namespace veriray {

inline constexpr double kPiDouble = 3.14159265358979323846;
inline constexpr float kShadowShorten = 1.f - 0x1p-21f;
// Of the scene about the origin: all coordinates are below 1.
inline constexpr float kSceneRadius = 0x1.bb67aep+0f, kSceneArea = 3.f * kPi;

// Columns of the light table (one row per light).
enum LightColumn : uint32_t {
    kLightP,                 // a vertex, the centre, or the position: 3 columns
    kLightE1 = kLightP + 3,  // edges or half axes: 3 columns each
    kLightE2 = kLightE1 + 3,
    kLightN = kLightE2 + 3,      // unit: normal of the emitting side, or the way the light goes
    kLightOffset = kLightN + 3,  // shift along the normal past the rounding of a point (flat.h)
    kLightShape,
    kLightInverse,   // once it is chosen: of flat lights the area, else 1
    kLightRadiance,  // radiance, intensity, or irradiance across the beam: 3 columns
    kLightPrimitive = kLightRadiance + 3,  // bits
    kLightTexture,                         // that the radiance is multiplied by; -1: none
    kLightLeaf,                            // bits: its branch of the tree
    kLightMore,                            // what a shape alone has
    kLightMoreColumns = 5,                 // of these
    kLightColumns = kLightMore + kLightMoreColumns,
};

// The lights of a scene.
struct LightView {
    const float* table;        // [column][stride]
    uint32_t stride, count;    // count: of the lights that are sampled, the first rows
    LightTreeView tree;        // of more than one light
    float sky[kLightColumns];  // its row, which is one for all lanes; black where there is none
    SkyMap map;                // its texels, if it has any
};

// A row of the light table by lane; read(c) gives a column. map: of the sky.
template <class L, class Read>
struct LightRow {
    using F = typename L::F;
    Read read;
    SkyMap map;

    VR_HD F operator()(uint32_t c) const { return read(c); }
    VR_HD Vec3<F> vector(uint32_t c) const { return {read(c), read(c + 1), read(c + 2)}; }
    VR_HD Spectrum<F> radiance() const {
        return Spectrum<F>::of([&](uint32_t k) { return read(kLightRadiance + k); });
    }
    VR_HD typename L::M is(uint32_t shape) const {
        return read(kLightShape) == F(static_cast<float>(shape));
    }
};
template <class L, class Read>
VR_HD LightRow<L, Read> light_row(Read read, const SkyMap& map) {
    return {read, map};
}

template <class L>
struct LightSample {
    using F = typename L::F;
    Spectrum<F> radiance;  // towards the receiver; 0 from the back
    F inverse_pdf;         // per solid angle; of a delta light 1; the choice comes later
    F distance;            // a shadow ray's length; infinity for directional lights
    Vec3<F> wi;            // unit; from the receiver's point itself
    typename L::M delta;   // no ray can meet the light
    typename L::U skip;    // primitive that does not block: the light, which the ray meets once
    typename L::U on{};    // of lamps, for textures: the primitive
    Vec3<F> place{};       // the point on it, or of a sphere its outward normal there
    Vec3<F> aim{};         // unit: of the shadow ray, which starts beside the point
};

// A density per solid angle, without the choice, as a fraction: who divides by another one divides
// once.
template <class F>
struct LightPdf {
    F over, under;
};

// The chance of lamps that are not sampled. Above 0, which is of no lamp.
inline constexpr float kNotSampled = 0x1p-100f;

// A lamp that a ray has met.
template <class L>
struct LightHit {
    using F = typename L::F;
    Vec3<F> from;  // the receiver
    F t;           // distance from there
    F cos_light;   // of the way back to the lamp's normal
    F chance;      // 1; over the area for flat lights

    VR_HD LightPdf<F> by_area() const { return {chance * (t * t), cos_light}; }
};

// Four numbers in [0, 1): a place and a direction.
template <class F>
struct EmissionNumbers {
    F u, v, s, t;
};
// Light that leaves a light: from p along d. The flux is radiance cosine / (pdf_area pdf_sa).
template <class L>
struct LightEmission {
    using F = typename L::F;
    Vec3<F> p, d;
    Spectrum<F> radiance;
    F cosine;            // of d to the lamp's normal; 1 where there is none
    F pdf_area, pdf_sa;  // 1 of what has one place or one direction
};

// Where rays find a light.
enum LightSite : uint32_t {
    kOnSurface,  // at a primitive
    kAtPoint,    // nowhere: at a place
    kFarAway,    // nowhere: in a direction
    kAllAround,  // where they leave the scene: the sky, one row at most
};

// Defaults: a lamp. Nothing else has a default, so that nothing is forgotten:
//   sample_li(row, p, from, u, v, lanes, nobody): the light as seen from p, with a shadow ray that
//     starts at `from`
//   pdf_li(row, hit): the density of these samples where a ray meets a lamp; of a sky
//     pdf_li(row, d, from), of those as seen from there
//   emit(row, numbers): light that leaves it
//   power(source): the flux that it emits, all channels, by which the tree of lights is built
//   bound(source): what it can give to a receiver
//   write(source, at): its columns of a row but for those that all rows have; at(c): a float&
// and of a sky radiance(row, d): that a ray along d meets.
template <class L>
struct LightShape {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;
    using Sample = LightSample<L>;
    using Pdf = LightPdf<F>;
    using Hit = LightHit<L>;
    using Emission = LightEmission<L>;
    using Numbers = EmissionNumbers<F>;

    static constexpr LightSite kSite = kOnSurface;
    static constexpr bool kSampled = true;   // else directions alone find it
    static constexpr bool kFlat = false;     // of flat.h
    static constexpr bool kSpreads = false;  // flat: maps numbers to places by spread()
    static constexpr bool kByAngle = false;  // flat: drawn by solid angle where place() says so
    static constexpr bool kPaired = false;   // flat: of two triangles, with a column kLightOther
    static constexpr bool kOwnPdf = false;   // lamps: pdf_li needs the row
    static constexpr bool kRound = false;    // the place of a sample is a normal: point(row, place)
    static constexpr bool kSkips = false;    // a shadow ray leaves its primitive out without a tree
    static constexpr bool kAimed = false;    // has a direction
    static constexpr bool kCone = false;     // at a point: with falloff(row, wi) within its angles
    static constexpr bool kImage = false;    // at a point: an image is read at image(row, wi, u, v)
    static constexpr bool kFramed = false;   // at a point: lights its image alone
    // Uniform in all directions, and as a function of nothing but the numbers.
    static VR_HD V any_direction(F s, F t) { return uniform_cone(s, t, F(2.f)); }
    static constexpr float kAnyPdf = 0.25f * kInvPi;

    // From a disc that covers the scene as seen along d.
    static VR_HD V before_scene(V d, F u, F v) {
        V a, b;
        orthonormal_frame(d, a, b);
        F x, y;
        uniform_disk(u, v, x, y);
        return fma(a, x, fma(b, y, -d)) * F(kSceneRadius);
    }
    // Lambert's lobe about n.
    static VR_HD V lambert(V n, F s, F t, F& cosine) {
        const V local = cosine_hemisphere(s, t);
        V a, b;
        orthonormal_frame(n, a, b);
        cosine = local.z;
        return fma(a, local.x, fma(b, local.y, n * local.z));
    }

    template <class At>
    static void write3(At at, uint32_t c, Vec3<double> v) {
        at(c) = static_cast<float>(v.x);
        at(c + 1) = static_cast<float>(v.y);
        at(c + 2) = static_cast<float>(v.z);
    }
};

// Takes the members of Base into a shape.
#define VR_LIGHT_SHAPE(...)                                                                \
    using Base = __VA_ARGS__;                                                              \
    using typename Base::F, typename Base::U, typename Base::M, typename Base::V;          \
    using typename Base::S, typename Base::Sample, typename Base::Pdf, typename Base::Hit; \
    using typename Base::Emission, typename Base::Numbers

}  // namespace veriray
