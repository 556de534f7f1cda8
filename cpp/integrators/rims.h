// The rims of faces without a tree (geometry/polygon.h); the backs of one-sided faces have none at
// edges of a body's silhouette.
#pragma once

#include "integrators/surface.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct Rims : SurfaceReader<L, kFeatures> {
    using Reader = SurfaceReader<L, kFeatures>;
    using Reader::has, Reader::primitive_column, Reader::primitive_column3, Reader::surface_column;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V;

    // In a scene without a tree, those lanes of `back` whose face is one-sided.
    static VR_HD M one_sided(const SceneView& scene, const Hit<L>& hit, M back) {
        const uint32_t faces = scene.quad_count + scene.polygon_count;
        back = back & (hit.t < F(kInfinity)) & (hit.primitive < U(faces));
        if (none(back)) return back;
        const U prim = select(back, hit.primitive, U(0u));
        return back & (surface_column(scene, prim, kSurfaceTwoSided) <= F(0.f));
    }
    static VR_HD M meets_back(const SceneView& scene, const Ray<L>& ray, const Hit<L>& hit,
                              M valid) {
        const U prim = select(valid & (hit.t < F(kInfinity)), hit.primitive, U(0u));
        return one_sided(scene, hit,
                         valid & (dot(primitive_column3(scene, prim, kPrimN), ray.d) > F(0.f)));
    }

    // Those lanes of `valid` whose point p, on the plane of the face, is off its rim on the inside,
    // or, for `wide`, within it or no further from it than it is wide.
    static VR_HD M within(const SceneView& scene, U prim, V p, M valid, bool wide) {
        prim = select(valid, prim, U(0u));
        const M quad = prim < U(scene.quad_count);
        const U i = select(quad, prim, prim + U(0u - scene.quad_count)) *
                    select(quad, U(kQuadFloats), U(kPolygonFloats));
        for (uint32_t k = 0; k < 4; ++k) {
            F edge[4];
            for (uint32_t c = 0; c < 4; ++c) {
                const uint32_t at = 4 + 4 * k + c;
                edge[c] =
                    select(quad, gather(scene.quads + (k < 2 ? at : 0), select(quad, i, U(0u))),
                           gather(scene.polygons + at, select(quad, U(0u), i)));
            }
            const F e = height_over<L>(edge, p), rim = primitive_column(scene, prim, kPrimRim + k);
            const F far = wide ? F(2.f) - rim : rim, near = wide ? -rim : rim;
            valid = valid & (((e >= near) & !quad) | (quad & (k < 2 ? abs(e) <= far : quad)));
        }
        return valid;
    }

    // Those lanes of `back` whose hit is on the rim of its face, at an edge of the silhouette: no
    // other face shows its back there.
    static VR_HD M on_rim(const SceneView& scene, const Ray<L>& ray, const Hit<L>& hit, M back) {
        if (none(back)) return back;
        const V p = ray.at(hit.t);
        M rim = back & !within(scene, hit.primitive, p, back, false);
        // p is within kEdgeSlack of an edge that both have, so it is that far at most from the
        // plane of the other, whose record lies kPlaneSlack behind, plus rounding.
        for (uint32_t i = 0; any(rim) && i < scene.quad_count + scene.polygon_count; ++i) {
            const V n = primitive_column3(scene, U(i), kPrimN);
            const F height = dot(n, p) - primitive_column(scene, U(i), kPrimPlane);
            rim = rim & !within(scene, U(i), p,
                                rim & !(hit.primitive == U(i)) & (dot(n, ray.d) > F(0.f)) &
                                    (abs(height) <= F(2 * kEdgeSlack)),
                                true);
        }
        return rim;
    }

    static VR_HD bool none_here(const SceneView& scene) {
        if constexpr (!has(kQuads | kPolygons)) return true;
        return has(kBvh) && (scene.features & kBvh) != 0;
    }

    // The hit of a path's ray, with hits on the rims of backs skipped.
    static VR_HD Hit<L> past_rims(const SceneView& scene, const Ray<L>& ray, Hit<L> hit, M active) {
        if (none_here(scene)) return hit;
        const M back = meets_back(scene, ray, hit, active);
        return none(back) ? hit : call_beyond_rims(scene, ray, hit, back);
    }

    // The same for rays to which nothing else happens on the way: replaces hits on rims, and the
    // surface there, by the next ones before `far`; returns the lanes that have none.
    static VR_HD M leave_rims(const SceneView& scene, const Ray<L>& ray, F far, Hit<L>& hit,
                              Surface<L>& at, M valid) {
        M back = valid & !at.front;
        if (none_here(scene) || none(back)) return back & !back;
        const Hit<L> next = beyond_rims(scene, ray, hit, one_sided(scene, hit, back));
        back = back & !(next.primitive == hit.primitive);
        if (none(back)) return back;
        hit = next;
        const M gone = back & !((hit.t <= far) & (hit.t < F(kInfinity)));
        at = Reader::surface_at(scene, ray, hit, valid & !gone);
        return gone;
    }

    // A call instead of inline code, for callers that need many registers themselves.
    static VR_RARE Hit<L> call_beyond_rims(const SceneView& scene, Ray<L> ray, Hit<L> hit, M back) {
        return beyond_rims(scene, ray, hit, back);
    }
    static VR_HD Hit<L> beyond_rims(const SceneView& scene, const Ray<L>& ray, Hit<L> hit, M back) {
        for (;;) {
            const M rim = on_rim(scene, ray, hit, back);
            if (none(rim)) return hit;
            const Hit<L> next = next_flat(scene, ray, hit);
            hit.t = select(rim, next.t, hit.t);
            hit.primitive = select(rim, next.primitive, hit.primitive);
            back = meets_back(scene, ray, hit, rim);
        }
    }

    // The nearest hit beyond `last` without a tree: as `closest`, for the few lanes that need it.
    static VR_HD Hit<L> next_flat(const SceneView& scene, const Ray<L>& ray, const Hit<L>& last) {
        Hit<L> hit{F(kInfinity), U(~0u)};
        uint32_t primitive = 0;
        const auto keep = [&](M met, F t) {
            const M take = met & beyond<L>(last, t, U(primitive));
            hit.t = select(take, t, hit.t);
            hit.primitive = select(take, U(primitive), hit.primitive);
            ++primitive;
        };
        F t;
        VR_ROLLED
        for (uint32_t i = 0; i < scene.quad_count; ++i) {
            const M met = meets_flat<L, 2>(scene.quads + i * kQuadFloats, ray, hit.t, t);
            keep(met, t);
        }
        if constexpr (has(kPolygons)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.polygon_count; ++i) {
                const M met = meets_flat<L, 4>(scene.polygons + i * kPolygonFloats, ray, hit.t, t);
                keep(met, t);
            }
        }
        if constexpr (has(kDisks)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.disk_count; ++i) {
                const M met = meets_disk<L>(scene.disks + i * kDiskFloats, ray, hit.t, t);
                keep(met, t);
            }
        }
        if constexpr (has(kSpheres)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.sphere_count; ++i) {
                const M met = meets_sphere<L>(scene.spheres + i * kSphereFloats, ray, last,
                                              U(primitive), hit.t, t);
                keep(met, t);
            }
        }
        return hit;
    }
};

}  // namespace veriray
