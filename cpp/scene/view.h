// The scene as the stages see it: plain pointers and numbers, passed by value.
// Lengths are normalised. The origin is the camera or a place near it, or the middle of a scene far
// away from it, or the place where a scene is finest. After a division by a power of two, the
// largest coordinate lies in [1/2, 1), or in a large scene the camera's distance.
#pragma once

#include "camera/perspective.h"
#include "film/filter.h"
#include "geometry/bvh.h"
#include "geometry/disk.h"
#include "geometry/polygon.h"
#include "geometry/sphere.h"
#include "lights/shape.h"
#include "media/medium.h"
#include "scene/features.h"
#include "textures/grid.h"
#include "textures/texture.h"

namespace veriray {

// Columns by primitive. A sphere has its record (geometry/sphere.h) from column 0 on.
enum PrimitiveColumn : uint32_t {
    kPrimN,                        // unit normal of the front: 3 columns
    kPrimPlane = kPrimN + 3,       // n.p on the primitive
    kPrimOffset = kPrimPlane + 1,  // of rays that leave the plane, past a point's rounding; -1:
                                   // kLocalOffset of the terms of n.p at the point; -2: likewise,
                                   // and it touches something that lets light through
    kPrimRim = kPrimOffset +
        1,              // without a tree: 4 columns, the face's own edges (geometry/polygon.h)
    kSphereCentre = 0,  // upper parts: 3 columns
    kSphereRadius = 6,  // upper part
    kPrimSide = kSphereFloats,  // spheres: -1 where the front is inside, else 1
    kPrimColumns,
};

inline constexpr float kLocal = -1.f, kTouches = -2.f;  // of kPrimOffset

// Interpolated normal as an affine function of the point on the triangle: 3 rows of {g, w}.
inline constexpr uint32_t kSmoothFloats = 12;

// Where on a primitive a texture is read: of faces u and v, of discs x and y between their axes, as
// affine functions of the point, 2 rows of {g, w}; of spheres the axes x and z with -1 or 1 behind
// the first, the side of y.
inline constexpr uint32_t kUvFloats = 8;

// Parameters that textures can give, in the order of the schema.
enum TexturableParameter : uint32_t {
#define VR_TEXTURABLE(name) kTexturable_##name,
#include "schema/materials.def"
    kTexturableCount,
};

// Of a primitive with tangents: of faces and discs two unit vectors, with a number behind each. Of
// faces the directions in which u and v alone grow, and how much per length; of discs likewise x
// and y between their axes. Of spheres the axes x and z, 1 / radius, and -1 or 1, the side of y.
inline constexpr uint32_t kTangentFloats = 8;

// How a surface's normals are turned: bits of kSurfaceReliefTraits.
enum ReliefTrait : uint32_t {
    kReliefHeights = 1,   // the texture gives heights; else normals
    kReliefFlips = 2,     // normals that look away from the viewer are turned about the surface's
    kReliefShades = 4,    // what is turned stands in its own shadow at grazing angles
    kReliefMirrored = 8,  // seen from behind, it is its mirror image
};

// Columns by surface (material, emission, media; equal to the primitive in small scenes).
enum SurfaceColumn : uint32_t {
// Of the material; opacity: a ray meets the material if its random number is below it.
#define VR_PARAMETER(name, width) \
    kSurface_##name, kSurface_##name##_last = kSurface_##name + width - 1,
#include "schema/materials.def"
// The texture that gives it; -1: none.
#define VR_TEXTURABLE(name) kSurface_##name##_texture,
#include "schema/materials.def"
    kSurfaceTextured,                                // a bit for each of these that is there
    kSurfaceRelief,                                  // the texture that turns normals; -1: none
    kSurfaceReliefTraits,                            // ReliefTrait
    kSurfaceRadiance,                                // emitted by the front: 3 columns
    kSurfaceRadianceTexture = kSurfaceRadiance + 3,  // that this is multiplied by; -1: none
    kSurfaceTwoSided,  // 0; 1; 2: and from behind it is the other material of its blend
    kSurfaceKind,      // MaterialKind
    kSurfaceInside,    // medium behind; -1: no change of medium
    kSurfaceOutside,   // medium in front
    kSurfaceOther,     // row of the other material of a blend; bits, ~0: none
    kSurfaceColumns,   // then, where a material has a table, its columns (bsdfs/rough_coat.h)
};

inline constexpr uint32_t kSurfaceFirstTexture = kSurface_reflectance_texture;

struct SceneView {
    FeatureMask features;
    uint32_t parameters = ~0u;  // of materials: a bit for each that they read
    // Primitives without a tree come in this order; with a tree: triangles, disks, spheres.
    uint32_t quad_count, polygon_count, disk_count, sphere_count;
    uint32_t first_occluder;  // quads before this one have all light samples in front of them
    uint32_t first_sphere;    // primitives from here on are spheres
    uint32_t primitive_count, primitive_row, primitive_column;
    uint32_t surface_count, surface_stride;
    uint32_t medium_stride;
    uint32_t camera_medium;
    bool shut_media;             // some medium is shut (kMediumShut)
    const float* primitives;     // [i * primitive_row + column * primitive_column]
    const float* smooth;         // by primitive: kSmoothFloats
    const float* uv;             // by primitive: kUvFloats; with kTextures or kTangents only
    const float* tangents;       // by primitive: kTangentFloats; with kTangents only
    const float* light_chance;   // by primitive: 1, / area if flat; 0: no emitter; -1: of 0, with
                                 // kHidden
    const float* light_row;      // by primitive: in the light table; null where nothing needs it
    const uint32_t* surface_of;  // by primitive; null: the same index
    const float* surfaces;       // [column][surface_stride]
    const float* media;          // [column][medium_stride]; medium 0 is the vacuum
    TextureView textures;
    PhaseView phases;  // with kPhases only
    GridView grids;
    BvhView bvh;
    LightView lights;
    CameraView camera;
    FilterView filter;
    float emission_scale;        // 2^-e of the film
    uint32_t muted_segments;     // light of paths of so many at most is left out
    const void* uniform_quads;   // CPU: the quads as Simd::Uniform
    const void* uniform_shorts;  // CPU: likewise, of kShortFloats, those across or along an axis
    const QuadRun* runs;         // CPU
    uint32_t run_count;
    float quads[kMaxFlat * kQuadFloats];
    float polygons[kMaxFlat * kPolygonFloats];
    float disks[kMaxFlat * kDiskFloats];
    float spheres[kMaxFlat * kSphereFloats];
};

}  // namespace veriray
