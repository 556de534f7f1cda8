// Unidirectional path tracing as stages on a path's state. A stage knows no loop, queue or launch:
// schedulers own those. J. Kajiya 1986; E. Veach 1997 (multiple importance sampling, chapter 9).
//
// Next-event estimation and BSDF sampling are combined by the balance heuristic, which bounds a
// light sample's contribution by radiance times throughput.
#pragma once

#include "film/film.h"
#include "integrators/ledger.h"
#include "materials/material.h"
#include "scene/view.h"

namespace veriray {

struct PathSettings {
    RandomKey key;
    uint32_t max_depth;  // segments at most; kHardMaxDepth for unlimited
    uint32_t rr_depth;   // roulette from the vertex with index + 1 >= rr_depth on
};

template <class L>
struct PathState {
    typename L::U pixel, sample;
    Ray<L> ray;
    Vec3<typename L::F> throughput, radiance;
    typename L::F pdf_sa;  // of the ray's direction; 0 where no light sample competes (camera)
};

// The state as columns of memory: the one list of its fields, for the schedulers that store it.
inline constexpr uint32_t kPathFloats = 13, kPathUints = 2;

// load_float(column), load_uint(column) -> lanes.
template <class L, class LoadFloat, class LoadUint>
VR_HD PathState<L> read_path(LoadFloat f, LoadUint u) {
    return {u(0),
            u(1),
            {{f(0), f(1), f(2)}, {f(3), f(4), f(5)}},
            {f(6), f(7), f(8)},
            {f(9), f(10), f(11)},
            f(12)};
}

// store(column, lanes) for both kinds.
template <class L, class StoreFloat, class StoreUint>
VR_HD void write_path(const PathState<L>& p, StoreFloat f, StoreUint u) {
    f(0, p.ray.o.x), f(1, p.ray.o.y), f(2, p.ray.o.z);
    f(3, p.ray.d.x), f(4, p.ray.d.y), f(5, p.ray.d.z);
    f(6, p.throughput.x), f(7, p.throughput.y), f(8, p.throughput.z);
    f(9, p.radiance.x), f(10, p.radiance.y), f(11, p.radiance.z);
    f(12, p.pdf_sa);
    u(0, p.pixel), u(1, p.sample);
}

template <class L>
struct ShadowRequest {
    typename L::M wanted;
    Ray<L> ray;
    typename L::F t_max;
    Vec3<typename L::F> radiance;  // added if the ray is free
};

// What happened to the lanes of a bounce; disjoint but for the shadow's two.
template <class L>
struct Events {
    typename L::M escaped, emitter_end, absorbed, depth_cut, rr_killed, alive;
    typename L::M visible, occluded;
};

// Surface under a hit, by lane.
template <class L>
struct Surface {
    Vec3<typename L::F> p;     // on the plane
    Vec3<typename L::F> n, s;  // unit normal of the front, unit tangent
    typename L::F offset;
    typename L::M front;  // the ray met the front
    typename L::U row;
};

template <class L, uint32_t kFeatures>
struct PathTracer {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;

    static VR_HD M no_lanes(M m) { return m & !m; }

    // ---- begin: a camera path through pixel (x, y) of a film `width` wide ----
    static VR_HD PathState<L> begin(const SceneView& scene, const PathSettings& s, U x, U y,
                                    uint32_t width, U sample) {
        PathState<L> path;
        path.pixel = y * U(width) + x;
        path.sample = sample;
        const Block<U> r = random_block(s.key, path.pixel, sample, dimension_block(0, kCamera));
        const F dx = F(0.5f) + filter_offset<L>(scene.filter, uniform(r.x));
        const F dy = F(0.5f) + filter_offset<L>(scene.filter, uniform(r.y));
        path.ray.d = camera_direction<L>(scene.camera, to_float(x), to_float(y), dx, dy);
        path.ray.o = broadcast<F>(scene.camera.origin);
        if constexpr (kFeatures & kClip) {
            const F cosine = dot(path.ray.d, broadcast<F>(scene.camera.forward));
            path.ray.o = fma(path.ray.d, F(scene.camera.near_clip) / cosine, path.ray.o);
        }
        path.throughput = {F(1.f), F(1.f), F(1.f)};
        path.radiance = {F(0.f), F(0.f), F(0.f)};
        path.pdf_sa = F(0.f);
        return path;
    }

    // ---- intersect ----
    // Calls test(kEdges, record, primitive) for every flat primitive in ascending order. Unrolled,
    // the loop runs out of uniform registers: 16 % slower on an H200.
    template <class Test>
    static VR_HD void each_flat(const SceneView& scene, Test test) {
        if constexpr (kFeatures & kQuads) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.quad_count; ++i)
                test(Edges<2>(), scene.quads + i * kQuadFloats, i);
        }
        if constexpr (kFeatures & kPolygons) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.polygon_count; ++i)
                test(Edges<4>(), scene.polygons + i * kPolygonFloats, scene.quad_count + i);
        }
    }

    static VR_HD Hit<L> closest(const SceneView& scene, const Ray<L>& ray, M active) {
        Hit<L> hit{F(kInfinity), U(~0u)};
        each_flat(scene, [&](auto edges, const float* record, uint32_t primitive) {
            F t;
            const M take = meets_flat<L, edges.value>(record, ray, hit.t, t);
            hit.t = select(take, t, hit.t);
            hit.primitive = select(take, U(primitive), hit.primitive);
        });
        if constexpr (kFeatures & kBvh)
            if (scene.features & kBvh) closest_in_bvh<L>(scene.bvh, ray, active, hit);
        return hit;
    }

    static VR_HD M occluded(const SceneView& scene, const ShadowRequest<L>& shadow) {
        M blocked = no_lanes(shadow.wanted);
        each_flat(scene, [&](auto edges, const float* record, uint32_t) {
            F t;
            blocked = blocked | meets_flat<L, edges.value>(record, shadow.ray, shadow.t_max, t);
        });
        if constexpr (kFeatures & kBvh)
            if (scene.features & kBvh)
                blocked = blocked | occluded_in_bvh<L>(scene.bvh, shadow.ray, shadow.t_max,
                                                       shadow.wanted & !blocked);
        return blocked & shadow.wanted;
    }

    // ---- miss: the environment ----
    static VR_HD void miss(const SceneView& scene, PathState<L>& path, M escaped) {
        if constexpr (kFeatures & kEnvironment) {
            const float share = static_cast<float>(scene.lights.environment_share) * 0x1p-24f;
            const F w = mis_weight(path.pdf_sa, F(share * kUniformSpherePdf));
            add_radiance(path, escaped, broadcast<F>(scene.lights.environment) * w);
        }
    }

    // ---- hit: the surface under the ray ----
    static VR_HD Surface<L> surface_at(const SceneView& scene, const Ray<L>& ray, const Hit<L>& hit,
                                       M valid) {
        const U prim = select(valid, hit.primitive, U(0u));
        const auto column = [&](uint32_t c) {
            return lookup(scene.primitives + static_cast<uint64_t>(c) * scene.primitive_stride,
                          prim, scene.primitive_count);
        };
        Surface<L> at;
        at.n = {column(kPrimN), column(kPrimN + 1), column(kPrimN + 2)};
        at.s = {column(kPrimS), column(kPrimS + 1), column(kPrimS + 2)};
        at.offset = column(kPrimOffset);
        at.p = ray.at(hit.t);
        at.p = fma(at.n, column(kPrimPlane) - dot(at.n, at.p), at.p);
        at.front = dot(at.n, ray.d) < F(0.f);
        at.row = prim;
        if constexpr (kFeatures & kBvh)
            if (scene.surface_of) at.row = gather(scene.surface_of, prim);
        return at;
    }

    static VR_HD F surface_column(const SceneView& scene, U row, uint32_t c) {
        return lookup(scene.surfaces + static_cast<uint64_t>(c) * scene.surface_stride, row,
                      scene.surface_count);
    }
    static VR_HD V surface_column3(const SceneView& scene, U row, uint32_t c) {
        return {surface_column(scene, row, c), surface_column(scene, row, c + 1),
                surface_column(scene, row, c + 2)};
    }

    // ---- hit emitter: adds emission, returns the lanes that met an emitter's front ----
    static VR_HD M hit_emitter(const SceneView& scene, PathState<L>& path, const Hit<L>& hit,
                               const Surface<L>& at, M valid) {
        M lit = no_lanes(valid);
        if constexpr (kFeatures & kAreaLights) {
            const F pdf_area = lookup(scene.light_pdf_area, select(valid, hit.primitive, U(0u)),
                                      scene.primitive_count);
            lit = valid & at.front & (pdf_area > F(0.f));
            if (any(lit)) {
                const F cos_light = -dot(at.n, path.ray.d);
                const F pdf_light = pdf_area * (hit.t * hit.t) / cos_light;
                const V emitted = surface_column3(scene, at.row, kSurfaceRadiance);
                add_radiance(path, lit, emitted * mis_weight(path.pdf_sa, pdf_light));
            }
        }
        return lit;
    }

    // ---- light sample: at most one shadow request a lane ----
    template <class Material>
    static VR_HD ShadowRequest<L> sample_light(const SceneView& scene, const PathSettings& s,
                                               const PathState<L>& path, const Material& material,
                                               V p, V n, uint32_t depth, Block<U> scatter,
                                               M active) {
        const LightView& lights = scene.lights;
        const F u = uniform(scatter.x), v = uniform(scatter.y);
        LightSample<F> light;
        constexpr bool triangles = (kFeatures & kTriangleLights) != 0;
        if constexpr (kFeatures & (kManyLights | kEnvironment)) {
            const uint32_t choices = lights.count + (lights.environment_share ? 1u : 0u);
            if (choices == 0) return {no_lanes(active), path.ray, F(0.f), path.throughput};
            U u24(0u);
            if (choices > 1)
                u24 = random_block(s.key, path.pixel, path.sample, dimension_block(depth, kDecide))
                          .x >>
                      8;
            const M sky = u24 < U(lights.environment_share);
            if (lights.count) {
                const U row = choose_area_light(lights, u24);
                const U safe = select(row < U(lights.count), row, U(0u));
                light = sample_area_light<L>(
                    [&](uint32_t c) {
                        return lookup(lights.table + c * lights.stride, safe, lights.count);
                    },
                    p, u, v, triangles);
            }
            if (lights.environment_share) {
                const LightSample<F> env = sample_environment<L>(lights, u, v);
                light = lights.count ? select_sample(sky, env, light) : env;
            }
        } else {
            light = sample_area_light<L>(
                [&](uint32_t c) { return F(lights.table[c * lights.stride]); }, p, u, v, triangles);
        }
        const F cos_i = dot(n, light.wi);
        const BsdfValue<F> bsdf = material.eval(cos_i);
        ShadowRequest<L> shadow;
        shadow.wanted = active & (cos_i > F(0.f)) & (max_component(light.radiance) > F(0.f));
        shadow.ray = {p, light.wi};
        shadow.t_max = light.distance;
        shadow.radiance =
            path.throughput * light.radiance * bsdf.f_cos * (F(1.f) / (light.pdf_sa + bsdf.pdf_sa));
        return shadow;
    }

    // ---- roulette: survive with q = min(1, max throughput), rounded up to a multiple of 2^-24 so
    // that the division is exact in expectation; returns the survivors ----
    static VR_HD M roulette(const PathSettings& s, PathState<L>& path, uint32_t depth, M active) {
        if (depth + 1 < s.rr_depth) return active;
        const F most = max_component(path.throughput);
        if (none(active & (most < F(1.f)))) return active;
        const F q =
            min(F(1.f), to_float(to_uint(min(most, F(1.f)) * F(0x1p24f)) + U(1u)) * F(0x1p-24f));
        const U u = random_block(s.key, path.pixel, path.sample, dimension_block(depth, kDecide)).y;
        const M survives = active & (uniform(u) < q);
        path.throughput = select(survives, path.throughput * (F(1.f) / q), path.throughput);
        return survives;
    }

    // ---- scatter: all of a vertex but the tracing. In: the hit of segment `depth`. Out: the next
    // ray in the path, the shadow request, and what became of the segment ----
    static VR_HD Events<L> scatter(const SceneView& scene, const PathSettings& s,
                                   PathState<L>& path, const Hit<L>& hit, uint32_t depth, M active,
                                   ShadowRequest<L>& shadow) {
        Events<L> e;
        const M nobody = no_lanes(active);
        e.emitter_end = e.absorbed = e.depth_cut = e.rr_killed = e.alive = nobody;
        e.visible = e.occluded = shadow.wanted = nobody;

        M valid = active & (hit.t < F(kInfinity));
        if constexpr (kFeatures & kClip)
            if (depth == 0) valid = valid & within_far(scene, path.ray, hit.t);
        e.escaped = active & !valid;
        if (any(e.escaped)) miss(scene, path, e.escaped);
        if (none(valid)) return e;

        const Surface<L> at = surface_at(scene, path.ray, hit, valid);
        const M lit = hit_emitter(scene, path, hit, at, valid);
        const V albedo = surface_column3(scene, at.row, kSurfaceAlbedo);
        const M black = valid & (max_component(albedo) <= F(0.f));
        const M back =
            valid & !at.front & (surface_column(scene, at.row, kSurfaceTwoSided) <= F(0.f));
        e.emitter_end = lit & black;
        e.absorbed = (black | back) & !e.emitter_end;
        const M scatters = valid & !(black | back);
        if (depth + 1 >= s.max_depth) {
            e.depth_cut = scatters;
            return e;
        }
        if (none(scatters)) return e;

        const Block<U> random =
            random_block(s.key, path.pixel, path.sample, dimension_block(depth, kScatter));
        const F side = select(at.front, F(1.f), F(-1.f));
        const V n = at.n * side;
        const V p = fma(n, at.offset, at.p);
        visit(MaterialKind::kDiffuse, albedo, [&](const auto& material) {
            if constexpr (kFeatures & (kAreaLights | kEnvironment))
                shadow = sample_light(scene, s, path, material, p, n, depth, random, scatters);
            const BsdfSample<F> next = material.sample(uniform(random.z), uniform(random.w));
            path.ray.o = p;
            path.ray.d = fma(at.s, next.wi.x, fma(cross(n, at.s), next.wi.y, n * next.wi.z));
            path.throughput = path.throughput * next.weight;
            path.pdf_sa = next.pdf_sa;
        });
        e.alive = roulette(s, path, depth, scatters);
        e.rr_killed = scatters & !e.alive;
        return e;
    }

    // ---- visible: a free shadow ray delivers ----
    static VR_HD void visible(PathState<L>& path, const ShadowRequest<L>& shadow, M free) {
        path.radiance = select(free, path.radiance + shadow.radiance, path.radiance);
    }

    // ---- one bounce: from the ray of segment `depth` to the next one ----
    static VR_HD Events<L> bounce(const SceneView& scene, const PathSettings& s, PathState<L>& path,
                                  uint32_t depth, M active) {
        ShadowRequest<L> shadow;
        const Hit<L> hit = closest(scene, path.ray, active);
        Events<L> e = scatter(scene, s, path, hit, depth, active, shadow);
        if (any(shadow.wanted)) {
            e.occluded = occluded(scene, shadow);
            e.visible = shadow.wanted & !e.occluded;
            visible(path, shadow, e.visible);
        }
        return e;
    }

   private:
    template <uint32_t kCount>
    struct Edges {
        static constexpr uint32_t value = kCount;
    };
    // Balance heuristic; 1 where no light sample competes.
    static VR_HD F mis_weight(F pdf, F other) {
        return select(pdf == F(0.f), F(1.f), pdf / (pdf + other));
    }
    static VR_HD void add_radiance(PathState<L>& path, M m, V radiance) {
        path.radiance = select(m, fma(path.throughput, radiance, path.radiance), path.radiance);
    }
    static VR_HD M within_far(const SceneView& scene, const Ray<L>& ray, F t) {
        const F cosine = dot(ray.d, broadcast<F>(scene.camera.forward));
        return t * cosine <= F(scene.camera.far_clip - scene.camera.near_clip);
    }
    static VR_HD LightSample<F> select_sample(M m, const LightSample<F>& a,
                                              const LightSample<F>& b) {
        return {select(m, a.radiance, b.radiance), select(m, a.pdf_sa, b.pdf_sa),
                select(m, a.distance, b.distance), select(m, a.wi, b.wi)};
    }
};

}  // namespace veriray
