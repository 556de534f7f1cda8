// From a ray and its hit to the surface there: closest hits, points, normals, materials.
#pragma once

#include "bsdfs/bsdf.h"
#include "integrators/flat_primitives.h"
#include "integrators/texturing.h"
#include "lights/light.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct SurfaceReader : FlatPrimitives<L, kFeatures> {
    using Flat = FlatPrimitives<L, kFeatures>;
    using Flat::has, Flat::uses;
    using typename Flat::F, typename Flat::U, typename Flat::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    static constexpr uint32_t kTreeKinds =
        kTreeTriangles | (has(kSpheres) ? kTreeSpheres : 0u) | (has(kDisks) ? kTreeDisks : 0u);
    // Code for trees, too, does not hold the loops over flat primitives; kernels do.
    static constexpr bool kCallsFlat = !VR_CUDA && has(kBvh);
    using Material = Bsdf<L, kinds_of(kFeatures)>;
    using Texturing = veriray::Texturing<L, has(kAttributes)>;

    // How far the ray of a path or shadow request has come.
    template <class Carrier>
    static VR_HD Hit<L> passed(const Carrier& c) {
        if constexpr (has(kPass)) return {c.travelled, c.passed};
        return nothing_met<L>();
    }

    // The nearest hit beyond `last` and before t_max; t = t_max and primitive ~0 where there is
    // none.
    static VR_HD Hit<L> closest(const SceneView& scene, const Ray<L>& ray, const Hit<L>& last,
                                F t_max, M active) {
        Hit<L> hit{t_max, U(~0u)};
        if constexpr (has(kBvh))
            if (scene.features & kBvh) {
                closest_in_bvh<L, kTreeKinds>(scene.bvh, ray, last, active, hit);
                return hit;
            }
        if constexpr (kCallsFlat)
            return CalledFlat<L>::closest(scene, ray, last, t_max);
        else
            return Flat::closest_flat(scene, ray, last, t_max);
    }

    static VR_HD M occluded(const SceneView& scene, const ShadowRequest<L>& shadow) {
        if constexpr (has(kBvh))
            if (scene.features & kBvh)
                return occluded_in_bvh<L, kTreeKinds>(scene.bvh, shadow.ray, shadow.t_max,
                                                      shadow.wanted, shadow.skip);
        if constexpr (kCallsFlat)
            return CalledFlat<L>::occluded(scene, shadow.ray, shadow.t_max, shadow.wanted,
                                           has(kSkippedLights) ? shadow.skip : U(~0u));
        else
            return Flat::occluded_flat(scene, shadow.ray, shadow.t_max, shadow.wanted, shadow.skip);
    }

    // Lanes whose hit is of the sheet that they passed there: rays meet both triangles at an edge.
    static VR_HD M same_sheet(const SceneView& scene, const Ray<L>& ray, const Hit<L>& last,
                              const Hit<L>& hit, M active) {
        M same = active & (last.t > F(0.f)) & (hit.t == last.t);
        if (none(same)) return same;
        const U a = select(same, hit.primitive, U(0u)), b = select(same, last.primitive, U(0u));
        same = same & !(a == b) & (surface_row(scene, a) == surface_row(scene, b));
        if constexpr (has(kSpheres)) same = same & (a < U(scene.first_sphere));
        const F turn = dot(primitive_column3(scene, a, kPrimN), ray.d) *
                       dot(primitive_column3(scene, b, kPrimN), ray.d);
        return same & (turn > F(0.f));
    }

    // The nearest hit of a path or shadow request before t_max, beyond the sheets it has passed.
    template <class Carrier>
    static VR_HD Hit<L> next_hit(const SceneView& scene, const Carrier& c, F t_max, M active) {
        Hit<L> last = passed(c), hit = closest(scene, c.ray, last, t_max, active);
        if constexpr (has(kPass)) {
            if (!(scene.features & kGoOn)) return hit;
            for (M again = same_sheet(scene, c.ray, last, hit, active); any(again);
                 again = same_sheet(scene, c.ray, last, hit, again)) {
                last.primitive = select(again, hit.primitive, last.primitive);
                const Hit<L> next = closest(scene, c.ray, last, t_max, again);
                hit.t = select(again, next.t, hit.t);
                hit.primitive = select(again, next.primitive, hit.primitive);
            }
        }
        return hit;
    }

    // What hits are sorted by: 0 for none, else 1 + the material's kind.
    static VR_HD U kind_of(const SceneView& scene, const Hit<L>& hit) {
        const M met = hit.t < F(kInfinity);
        if (none(met)) return U(0u);
        if constexpr (Material::kOneKind) return select(met, U(1u), U(0u));
        const U row = surface_row(scene, select(met, hit.primitive, U(0u)));
        return select(met, U(1u) + to_uint(surface_column(scene, row, kSurfaceKind)), U(0u));
    }

    static VR_HD U surface_row(const SceneView& scene, U primitive) {
        if constexpr (has(kBvh))
            if (scene.surface_of) return gather(scene.surface_of, primitive);
        return primitive;
    }

    static VR_HD F primitive_column(const SceneView& scene, U primitive, uint32_t c) {
        const float* column = scene.primitives + static_cast<uint64_t>(c) * scene.primitive_column;
        if constexpr (has(kBvh))
            if (scene.features & kBvh) return gather(column, primitive * U(scene.primitive_row));
        return lookup(column, primitive, scene.primitive_count);
    }
    // Four columns from a multiple of four on.
    static VR_HD void primitive_columns(const SceneView& scene, U primitive, uint32_t c,
                                        F (&columns)[4]) {
        if constexpr (has(kBvh))
            if (scene.features & kBvh)
                return gather4(scene.primitives + c, primitive * U(scene.primitive_row), columns);
        for (uint32_t k = 0; k < 4; ++k) columns[k] = primitive_column(scene, primitive, c + k);
    }
    static VR_HD V primitive_column3(const SceneView& scene, U primitive, uint32_t c) {
        return {primitive_column(scene, primitive, c), primitive_column(scene, primitive, c + 1),
                primitive_column(scene, primitive, c + 2)};
    }
    static VR_HD void sphere_record(const SceneView& scene, U primitive,
                                    F (&record)[kSphereFloats]) {
        static_assert(kSphereFloats == 8);
        for (uint32_t c = 0; c < kSphereFloats; c += 4) {
            F four[4];
            primitive_columns(scene, primitive, c, four);
            for (uint32_t k = 0; k < 4; ++k) record[c + k] = four[k];
        }
    }

    // Clear surfaces, not to be black, take the geometric normal where the other looks away.
    static VR_HD void face_viewer(const Material& bsdf, V wo, V ng, V& ns, F& cosine) {
        if constexpr (Material::kClear) {
            const M away = bsdf.clear() & !(cosine > F(0.f));
            if (none(away)) return;
            V seen = fma(wo, F(0x1p-6f) - cosine, ns);
            seen = seen * (F(1.f) / sqrt(dot(seen, seen)));
            ns = select(away, select(bsdf.refracts_as_round(ns, ng), seen, ng), ns);
            cosine = select(away, dot(ns, wo), cosine);
        }
    }

    static VR_HD Surface<L> surface_at(const SceneView& scene, const Ray<L>& ray, const Hit<L>& hit,
                                       M valid) {
        const U prim = select(valid, hit.primitive, U(0u));
        Surface<L> at;
        static_assert(kPrimN == 0 && kPrimPlane == 3);
        F plane[4];
        if constexpr (has(kBvh))
            primitive_columns(scene, prim, kPrimN, plane);
        else  // the last one when it is needed: eight registers less on CUDA
            for (uint32_t k = 0; k < 3; ++k) plane[k] = primitive_column(scene, prim, k);
        at.ng = {plane[0], plane[1], plane[2]};
        at.offset = primitive_column(scene, prim, kPrimOffset);
        at.p = ray.at(hit.t);
        if constexpr (!has(kBvh)) plane[3] = primitive_column(scene, prim, kPrimPlane);
        const F off = plane[3] - dot(at.ng, at.p);
        at.p = fma(at.ng, off, at.p);
        if constexpr (has(kLocalOffsets)) {
            const M local = at.offset < F(0.f);
            if (any(local)) at.offset = select(local, local_offset(at.ng, at.p, off), at.offset);
        }
        at.ns = at.ng;
        if constexpr (has(kSmooth))
            if (scene.smooth) at.ns = interpolated(scene, prim, at);
        if constexpr (has(kSpheres)) {
            const M round = valid & !(prim < U(scene.first_sphere));
            if (any(round)) {
                F record[kSphereFloats];
                sphere_record(scene, prim, record);
                const SpherePoint<F> s = sphere_point(record, ray.o, ray.d, hit.t);
                const V n = s.n * primitive_column(scene, prim, kPrimSide);
                at.ng = select(round, n, at.ng);
                at.ns = select(round, n, at.ns);
                at.p = select(round, s.p, at.p);
                at.offset = select(round, s.offset, at.offset);
            }
        }
        at.front = dot(at.ng, ray.d) < F(0.f);
        at.row = surface_row(scene, prim);
        if constexpr (has(kTextures | kTangents)) {
            const auto outward = [&] { return at.ng * primitive_column(scene, prim, kPrimSide); };
            at.uv = Texturing::template place<kFeatures>(scene, prim, at.p, outward);
        }
        return at;
    }

    // The interpolated normal; the geometric one where it vanishes or the surface is not smooth.
    static VR_HD V interpolated(const SceneView& scene, U prim, const Surface<L>& at) {
        const bool spheres = has(kSpheres) && scene.sphere_count;
        const M flat = spheres ? !(prim < U(scene.first_sphere)) : at.offset < F(0.f);
        const U row = select(flat, U(0u), prim) * U(kSmoothFloats);
        F n[3];
        for (uint32_t k = 0; k < 3; ++k) {
            F g[4];
            gather4(scene.smooth + 4 * k, row, g);
            n[k] = fma(g[2], at.p.z, fma(g[1], at.p.y, fma(g[0], at.p.x, g[3])));
        }
        const V ns{n[0], n[1], n[2]};
        const F d2 = dot(ns, ns);
        return select(d2 > F(0.f), ns * (F(1.f) / sqrt(d2)), at.ng);
    }

    static VR_HD F surface_column(const SceneView& scene, U row, uint32_t c) {
        return lookup(scene.surfaces + static_cast<uint64_t>(c) * scene.surface_stride, row,
                      scene.surface_count);
    }
    static VR_HD S surface_spectrum(const SceneView& scene, U row, uint32_t c) {
        return S::of([&](uint32_t k) { return surface_column(scene, row, c + k); });
    }

    static VR_HD void read(const SceneView& scene, U row, uint32_t c, F& value) {
        value = surface_column(scene, row, c);
    }
    static VR_HD void read(const SceneView& scene, U row, uint32_t c, S& value) {
        value = surface_spectrum(scene, row, c);
    }

    static VR_HD Material material(const SceneView& scene, const Surface<L>& at) {
        const U row = at.row;
        Material m;
        m.kind = U(only_kind(kinds_of(kFeatures)));
        if constexpr (!Material::kOneKind)
            m.kind = to_uint(surface_column(scene, row, kSurfaceKind));
        m.present = kinds_of(scene.features);
#define VR_PARAMETER(name, width)                                                    \
    if constexpr (Material::reads(kParameter_##name)) {                              \
        if (Material::kFew || (scene.parameters & parameter_bit(kParameter_##name))) \
            read(scene, row, kSurface_##name, m.parameters.name);                    \
        else                                                                         \
            m.parameters.name = {};                                                  \
    }
#include "schema/materials.def"
        if constexpr (has(kTextures)) {
            const auto column = [&](uint32_t c)
                                    VR_INLINED { return surface_column(scene, row, c); };
            Texturing::replace(scene, column, at.uv, m);
        }
        if constexpr (Material::has(kTables)) {
            const uint64_t first = static_cast<uint64_t>(kSurfaceColumns) * scene.surface_stride;
            if (scene.features & materials(kTables)) m.view.table.columns = scene.surfaces + first;
            m.view.table.stride = scene.surface_stride, m.view.table.row = row;
        }
        return m;
    }
};

}  // namespace veriray
