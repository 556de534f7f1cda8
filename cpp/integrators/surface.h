// From a ray and its hit to the surface there: closest hits, points, normals, materials.
#pragma once

#include <type_traits>

#include "bsdfs/bsdf.h"
#include "integrators/path_state.h"
#include "integrators/texturing.h"
#include "lights/light.h"

namespace veriray {

#if VR_CUDA
// A block's copy of the scene's quads: a record takes three loads here, seven from the constant
// bank, which was a tenth of the Cornell box's time (H200). Kernels that trace fill it first, and
// wait for each other.
__device__ inline QuadRecord* block_quads() {
    __shared__ QuadRecord copy[kMaxFlat];
    return copy;
}

template <FeatureMask kFeatures>
__device__ void fill_block_quads(const SceneView& scene) {
    if constexpr ((kFeatures & kQuads) != 0) {
        float* const copy = block_quads()->v;
        for (uint32_t i = threadIdx.x; i < scene.quad_count * kQuadFloats; i += blockDim.x)
            copy[i] = scene.quads[i];
    }
}
#endif

template <class L, FeatureMask kFeatures>
struct SurfaceReader {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    static constexpr bool has(FeatureMask features) { return (kFeatures & features) != 0; }
    static constexpr uint32_t kTreeKinds =
        kTreeTriangles | (has(kSpheres) ? kTreeSpheres : 0u) | (has(kDisks) ? kTreeDisks : 0u);
    using Material = Bsdf<L, kinds_of(kFeatures)>;
    using Texturing = veriray::Texturing<L, has(kAttributes)>;

    static constexpr bool kOneLane = std::is_same_v<F, float>;

    // The record of quad i: on a CPU laid out for lanes, on CUDA from the block's copy.
    static VR_HD auto quad(const SceneView& scene, uint32_t i) {
        if constexpr (!kOneLane) {
            return static_cast<const typename L::Uniform*>(scene.uniform_quads) + i * kQuadFloats;
        } else {
#if VR_DEVICE_CODE
            return block_quads()[i];
#else
            QuadRecord record;
            memcpy(record.v, scene.quads + i * kQuadFloats, sizeof record.v);
            return record;
#endif
        }
    }

    // Tests the quads of a run from i on.
    template <uint32_t kWay, class Test>
    static VR_HD void each_of_run(const SceneView& scene, const Ray<L>& ray, uint32_t i,
                                  uint32_t end, Test test) {
        VR_ROLLED
        for (; i < end; ++i)
            test(
                [&](F t_max, F& t) {
                    if constexpr (kWay == kAnyWay) {
                        const auto record = quad(scene, i);
                        return meets_flat<L, 2>(&record[0], ray, t_max, t);
                    } else
                        return meets_short<L, kWay>(
                            static_cast<const typename L::Uniform*>(scene.uniform_shorts) +
                                i * kShortFloats,
                            ray, t_max, t);
                },
                i);
    }

    // Quads from i on, run by run. With one lane the runs of a box are too short to pay.
    template <class Test>
    static VR_HD void each_quad_by_runs(const SceneView& scene, const Ray<L>& ray, uint32_t i,
                                        Test test) {
        for (uint32_t k = 0; k < scene.run_count; ++k) {
            const QuadRun run = scene.runs[k];
            if (run.end <= i) continue;
            switch (run.way) {
                case 0:
                    each_of_run<0>(scene, ray, i, run.end, test);
                    break;
                case 1:
                    each_of_run<1>(scene, ray, i, run.end, test);
                    break;
                case 2:
                    each_of_run<2>(scene, ray, i, run.end, test);
                    break;
                case kAlong:
                    each_of_run<kAlong>(scene, ray, i, run.end, test);
                    break;
                case kAlong + 1:
                    each_of_run<kAlong + 1>(scene, ray, i, run.end, test);
                    break;
                case kAlong + 2:
                    each_of_run<kAlong + 2>(scene, ray, i, run.end, test);
                    break;
                default:
                    each_of_run<kAnyWay>(scene, ray, i, run.end, test);
            }
            i = run.end;
        }
    }

    // Calls test(meets, primitive) for every primitive from `first` (a quad) on of a scene without
    // a tree in ascending order; meets(t_max, t) tells whether the ray meets it at 0 < t < t_max,
    // where first, and a sphere beyond `last`.
    // On CUDA a block's copy of the quads must have been filled.
    template <class Test>
    static VR_HD void each_flat(const SceneView& scene, const Ray<L>& ray, const Hit<L>& last,
                                uint32_t first, Test test) {
        uint32_t primitive = 0;
        if constexpr (has(kQuads)) {
            if constexpr (kOneLane)
                each_of_run<kAnyWay>(scene, ray, first, scene.quad_count, test);
            else
                each_quad_by_runs(scene, ray, first, test);
            primitive = scene.quad_count;
        }
        if constexpr (has(kPolygons)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.polygon_count; ++i)
                test(
                    [&](F t_max, F& t) {
                        return meets_flat<L, 4>(scene.polygons + i * kPolygonFloats, ray, t_max, t);
                    },
                    primitive + i);
            primitive += scene.polygon_count;
        }
        if constexpr (has(kDisks)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.disk_count; ++i)
                test(
                    [&](F t_max, F& t) {
                        return meets_disk<L>(scene.disks + i * kDiskFloats, ray, t_max, t);
                    },
                    primitive + i);
            primitive += scene.disk_count;
        }
        if constexpr (has(kSpheres)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.sphere_count; ++i)
                test(
                    [&](F t_max, F& t) {
                        return meets_sphere<L>(scene.spheres + i * kSphereFloats, ray, last,
                                               U(primitive + i), t_max, t);
                    },
                    primitive + i);
        }
    }

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
        each_flat(scene, ray, last, 0, [&](auto meets, uint32_t primitive) {
            F t;
            M take = meets(hit.t, t);
            if constexpr (has(kPass)) take = take & beyond<L>(last, t, U(primitive));
            hit.t = select(take, t, hit.t);
            hit.primitive = select(take, U(primitive), hit.primitive);
        });
        return hit;
    }

    // The first quad that shadow rays can meet: from in front of a plane to in front of it, none
    // meets it.
    static VR_HD uint32_t first_blocker(const SceneView& scene, const ShadowRequest<L>& shadow) {
        if constexpr (has(kQuads)) {
            M behind = shadow.wanted & !shadow.wanted;
            VR_ROLLED
            for (uint32_t i = 0; i < scene.first_occluder; ++i) {
                const auto record = quad(scene, i);
                const F height = height_over<L>(&record[0], shadow.ray.o);
                behind = behind | !(height > F(0.f));
            }
            if (none(behind & shadow.wanted)) return scene.first_occluder;
        }
        return 0;
    }

    static VR_HD M occluded(const SceneView& scene, const ShadowRequest<L>& shadow) {
        if constexpr (has(kBvh))
            if (scene.features & kBvh)
                return occluded_in_bvh<L, kTreeKinds>(scene.bvh, shadow.ray, shadow.t_max,
                                                      shadow.wanted, shadow.skip);
        M blocked = shadow.wanted & !shadow.wanted;
        uint32_t mark = 0;  // CUDA: a condition kept in a register costs two instructions more
        each_flat(scene, shadow.ray, nothing_met<L>(), first_blocker(scene, shadow),
                  [&](auto meets, uint32_t primitive) {
                      F t;
                      M hit = meets(shadow.t_max, t);
                      if constexpr (has(kSkippedLights)) hit = hit & !(shadow.skip == U(primitive));
                      if constexpr (kOneLane)
                          mark = hit ? 1u : mark;
                      else
                          blocked = blocked | hit;
                  });
        if constexpr (kOneLane) blocked = mark != 0;
        return blocked & shadow.wanted;
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
    static VR_HD V primitive_column3(const SceneView& scene, U primitive, uint32_t c) {
        return {primitive_column(scene, primitive, c), primitive_column(scene, primitive, c + 1),
                primitive_column(scene, primitive, c + 2)};
    }
    static VR_HD void sphere_record(const SceneView& scene, U primitive, F record[kSphereFloats]) {
        for (uint32_t c = 0; c < kSphereFloats; ++c)
            record[c] = primitive_column(scene, primitive, c);
    }

    // Clear surfaces, not to be black, take the geometric normal where the other looks away.
    static VR_HD void face_viewer(const Material& bsdf, V wo, V ng, V& ns, F& cosine) {
        if constexpr (Material::kClear) {
            const M away = bsdf.clear() & !(cosine > F(0.f));
            if (none(away)) return;
            ns = select(away, ng, ns);
            cosine = select(away, dot(ng, wo), cosine);
        }
    }

    // Of n.p: what its rounding is in proportion to.
    static VR_HD F terms(V n, V p) {
        return fma(abs(n.z), abs(p.z), fma(abs(n.y), abs(p.y), abs(n.x) * abs(p.x)));
    }

    static VR_HD Surface<L> surface_at(const SceneView& scene, const Ray<L>& ray, const Hit<L>& hit,
                                       M valid) {
        const U prim = select(valid, hit.primitive, U(0u));
        Surface<L> at;
        at.ng = primitive_column3(scene, prim, kPrimN);
        at.offset = primitive_column(scene, prim, kPrimOffset);
        at.p = ray.at(hit.t);
        const F off = primitive_column(scene, prim, kPrimPlane) - dot(at.ng, at.p);
        at.p = fma(at.ng, off, at.p);
        if constexpr (has(kLocalOffsets)) {
            const M local = at.offset < F(0.f);
            if (any(local))
                at.offset = select(
                    local, max(terms(at.ng, at.p), abs(off) * F(kLocalMove)) * F(kLocalOffset),
                    at.offset);
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
            const auto g = [&](uint32_t c) { return gather(scene.smooth + 4 * k + c, row); };
            n[k] = fma(g(2), at.p.z, fma(g(1), at.p.y, fma(g(0), at.p.x, g(3))));
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
#define VR_PARAMETER(name, width)                     \
    if constexpr (Material::reads(kParameter_##name)) \
        read(scene, row, kSurface_##name, m.parameters.name);
#include "schema/materials.def"
        if constexpr (has(kTextures)) {
            const auto column = [&](uint32_t c)
                                    VR_INLINED { return surface_column(scene, row, c); };
            Texturing::replace(scene, column, at.uv, m);
        }
        if constexpr (Material::has(kCoatTables)) {
            const uint64_t first = static_cast<uint64_t>(kSurfaceColumns) * scene.surface_stride;
            if (scene.features & materials(kCoatTables))
                m.view.coat.columns = scene.surfaces + first;
            m.view.coat.stride = scene.surface_stride, m.view.coat.row = row;
        }
        return m;
    }
};

}  // namespace veriray
