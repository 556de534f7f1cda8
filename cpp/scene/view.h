// The scene as the stages see it: plain pointers and numbers, passed by value.
// Lengths are normalised: the scene's centre is the origin and the largest coordinate lies in
// [1/2, 1) after a division by a power of two.
#pragma once

#include "camera/perspective.h"
#include "film/filter.h"
#include "geometry/bvh.h"
#include "geometry/polygon.h"
#include "lights/light.h"
#include "scene/features.h"

namespace veriray {

// Columns by primitive.
enum PrimitiveColumn : uint32_t {
    kPrimN,                    // unit normal of the front: 3 columns
    kPrimPlane = kPrimN + 3,   // n.p on the primitive
    kPrimS,                    // unit tangent: 3 columns
    kPrimOffset = kPrimS + 3,  // distance to leave the plane by, past the rounding of a point on it
    kPrimColumns,
};

// Columns by surface (material and emission; equal to the primitive in small scenes).
enum SurfaceColumn : uint32_t {
    kSurfaceAlbedo,                           // 3 columns
    kSurfaceRadiance = kSurfaceAlbedo + 3,    // emitted by the front: 3 columns
    kSurfaceTwoSided = kSurfaceRadiance + 3,  // 1 or 0
    kSurfaceColumns,
};

struct SceneView {
    uint32_t features;
    uint32_t quad_count, polygon_count;  // primitives: quads first, then polygons; or all triangles
    uint32_t primitive_count, primitive_stride;
    uint32_t surface_count, surface_stride;
    const float* primitives;      // [column][primitive_stride]
    const float* light_pdf_area;  // by primitive: choice probability / area; 0: no emitter
    const uint32_t* surface_of;   // by primitive; null: the same index
    const float* surfaces;        // [column][surface_stride]
    BvhView bvh;
    LightView lights;
    CameraView camera;
    FilterView filter;
    float emission_scale;  // 2^-e of the film
    float quads[kMaxFlat * kQuadFloats];
    float polygons[kMaxFlat * kPolygonFloats];
};

}  // namespace veriray
