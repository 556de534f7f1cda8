// Unidirectional path tracing as stages on a path's state, which know no loop, queue or launch:
// schedulers own those. J. Kajiya 1986; E. Veach 1997 (multiple importance sampling, chapter 9).
// Next-event estimation and direction sampling are combined by the power heuristic with exponent 2.
// A constant environment has no light samples: sampled directions meet all of it alike. A segment
// is a ray from one surface or collision to the next; passes (null surfaces, uncovered parts of
// masks, thin glass) end a segment but are no vertices: depth, roulette and the density for the
// heuristic skip them.
#pragma once

#include "film/film.h"
#include "integrators/vertex.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct PathTracer : PathVertices<L, kFeatures> {
    using Reader = SurfaceReader<L, kFeatures>;
    using Direct = DirectLight<L, kFeatures>;
    using Vertices = PathVertices<L, kFeatures>;
    using Direct::black, Direct::medium_beyond, Direct::no_lanes, Direct::request,
        Direct::unblocked, Direct::white;
    using Reader::has, Reader::uses;
    using typename Direct::Place, typename Direct::Vertex;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V,
        typename Reader::S;
    using typename Reader::Material;
    using Vertices::arrive, Vertices::reach, Vertices::scatter_at_surface,
        Vertices::scatter_in_medium, Vertices::surface_vertex;
    using Lane = L;
    static constexpr FeatureMask kMask = kFeatures;
    static constexpr bool kNegativeSamples = false;
    using State = PathState<L>;
    using Request = ShadowRequest<L>;
    template <FeatureMask kOther>
    using With = PathTracer<L, kOther>;

    template <uint32_t kUse, class Path, class FloatField, class UintField>
    static VR_HD void each_field(Path& p, FloatField f, UintField u) {
        each_path_field<kFeatures, kUse>(p, f, u);
    }
    template <class Shadow, class FloatField, class UintField>
    static VR_HD void each_request_field(Shadow& s, FloatField f, UintField u) {
        each_shadow_field<kFeatures>(s, f, u);
    }
    static constexpr ColumnCount columns(FeatureMask features) { return path_columns(features); }
    static constexpr ColumnCount request_columns(FeatureMask features) {
        return shadow_columns(features);
    }
    static VR_HD Request no_request(M m) {
        const V nowhere{F(0.f), F(0.f), F(0.f)};
        return {no_lanes(m), {nowhere, nowhere},   F(0.f), black(), U(0u), U(0u), F(0.f),
                U(~0u),      {U(0u), U(0u), U(0u)}};
    }

    // ---- begin: a camera path through pixel (x, y) of a film `width` wide ----
    static VR_HD PathState<L> begin(const SceneView& scene, const PathSettings& s, U x, U y,
                                    uint32_t width, U sample) {
        PathState<L> path;
        path.pixel = y * U(width) + x + U(s.first);
        path.sample = sample;
        const Block<U> r = random_block(s.key, path.pixel, sample, dimension_block(0, kCamera));
        const F dx = F(0.5f) + filter_offset<L>(scene.filter, uniform(r.x));
        const F dy = F(0.5f) + filter_offset<L>(scene.filter, uniform(r.y));
        const F rim(static_cast<float>(s.rim)), px = to_float(x) - rim, py = to_float(y) - rim;
        const V at = camera_point(scene.camera, px, py, dx, dy);
        path.ray = pinhole_ray<L>(scene.camera, at);
        if (scene.camera.before > 0.f) path.ray = far_ray<L>(scene.camera, px, py, dx, dy);
        if constexpr (has(kLens))
            if (scene.features & kLens)
                path.ray = lens_ray<L>(scene.camera, at, uniform(r.z), uniform(r.w));
        if constexpr (has(kClip))
            if (uses(scene, kClip)) {
                const F cosine = dot(path.ray.d, broadcast<F>(scene.camera.forward));
                path.ray.o = fma(path.ray.d, F(scene.camera.near_clip) / cosine, path.ray.o);
            }
        path.throughput = white();
        if constexpr (has(kLens))
            if (scene.camera.meter.kind != MeterKind::kNone) {
                const auto from =
                    meter_ray<L>(scene.camera.meter, broadcast<F>(scene.camera.forward), px + dx,
                                 py + dy, uniform(r.z), uniform(r.w));
                path.ray = from.ray;
                path.throughput = S::all(from.weight);
            }
        path.radiance = black();
        path.pdf_sa = F(0.f);
        path.scale = F(1.f);
        path.travelled = F(0.f);
        path.passed = U(~0u);
        path.vertices = U(0u);
        path.medium = U(scene.camera_medium);
        path.flight = F(kInfinity);
        if constexpr (has(kMedia))
            if (scene.camera_medium)
                Vertices::set_out(scene, s, path, 0, F(0.f), path.pixel == path.pixel);
        path.facing = U(0u);
        return path;
    }

    // Where a path went through its pixel, under a box.
    static VR_HD void place_in_pixel(const PathSettings& s, U pixel, U sample, F& x, F& y) {
        const Block<U> r = random_block(s.key, pixel, sample, dimension_block(0, kCamera));
        x = uniform(r.x), y = uniform(r.y);
    }

    // ---- roulette: survive with q = min(1, max throughput), rounded up to a multiple of 2^-24 so
    // that the division is exact in expectation; returns the survivors ----
    static VR_HD M roulette(const SceneView& scene, const PathSettings& s, PathState<L>& path,
                            uint32_t segment, M active) {
        M plays = active;
        if (uses(scene, kGoOn))
            plays = plays & !(path.vertices < U(s.rr_depth));
        else if (segment + 1 < s.rr_depth)
            return active;
        F most = max_channel(path.throughput);
        if (uses(scene, kRefraction)) most = most * path.scale;
        plays = plays & (most < F(1.f));
        if (none(plays)) return active;
        const F q =
            min(F(1.f), to_float(to_uint(min(most, F(1.f)) * F(0x1p24f)) + U(1u)) * F(0x1p-24f));
        const U u =
            random_block(s.key, path.pixel, path.sample, dimension_block(segment, kDecide)).y;
        const M survives = plays & (uniform(u) < q);
        path.throughput = select(survives, path.throughput * (F(1.f) / q), path.throughput);
        return survives | (active & !plays);
    }

    // ---- scatter: all of a segment's end but the tracing. In: the hit of the segment. Out: the
    // next ray in the path, the shadow request, and what became of the segment ----
    static VR_HD Events<L> scatter(const SceneView& scene, const PathSettings& s,
                                   PathState<L>& path, Hit<L> hit, uint32_t segment, M active,
                                   ShadowRequest<L>& shadow) {
        Events<L> e;
        const M nobody = no_lanes(active);
        e.emitter_end = e.absorbed = e.depth_cut = e.rr_killed = e.alive = nobody;
        e.visible = e.occluded = e.collided = shadow.wanted = nobody;
        Place place;
        place.hit = hit;
        // What the path has met so far: of few segments, only light samples at blends whose lane
        // went straight on.
        S met = black();
        if constexpr (has(kBlend)) met = path.radiance;
        const F far = Vertices::far_end(scene, path, segment);
        M valid = arrive(scene, s, path, far, segment, active, place, e);
        if (none(valid | place.collided)) {
            mute(scene, path, segment, active, met);
            return e;
        }
        reach(scene, path, far, valid, place, e);
        surface_vertex(scene, s, path, segment, valid, place, e);
        mute(scene, path, segment, active, met);
        const M deep = beyond_depth(scene, s, path, segment, place.scatters);
        if (!uses(scene, kGoOn) && any(deep)) {
            e.depth_cut = deep;
            return e;
        }
        [[maybe_unused]] M mixed;  // lanes of blends, whose light samples no choice decides on
        if constexpr (has(kBlend)) {
            mixed = place.choice.mixed & !beyond_depth(scene, s, path, segment, place.choice.mixed);
            if (none(place.scatters | place.pass | mixed)) return e;
        } else if (none(place.scatters | place.pass))
            return e;

        if constexpr (has(kManyLights))
            if (scene.lights.count > 1)
                place.vertex.facing = Direct::facing_of(scene, -path.ray.d, place);
        // Light samples, and the direction to go on, which comes first in blends: these weigh both.
        const Block<U> random =
            random_block(s.key, path.pixel, path.sample, dimension_block(segment, kScatter));
        [[maybe_unused]] BsdfSample<L> drawn;
        [[maybe_unused]] bool weighed = false;
        if constexpr (has(kAnyLight)) {
            M receives = ((place.scatters & place.bsdf.scatters()) | place.collided) & !deep;
            if constexpr (has(kBlend)) receives = receives | mixed;
            if (scene.muted_segments)  // a light sample is one segment more
                receives = deeper(scene, scene.muted_segments, path, segment, receives);
            if constexpr (has(kBlend))
                drawn = scatter_at_surface(scene, s, path, segment, random, deep, valid, place, e);
            if (scene.lights.count && any(receives)) {
                request(scene, s, path, place, segment, random, receives, drawn, shadow);
                weighed = true;
                if constexpr (has(kMedia))
                    e.occluded = Direct::shut_in(scene, path, place.collided, shadow);
            }
        }
        BsdfSample<L> next;
        if constexpr (!has(kBlend) || !has(kAnyLight))
            next = scatter_at_surface(scene, s, path, segment, random, deep, valid, place, e);
        else
            next = drawn;
        if constexpr (has(kBlend))
            if (!weighed) Direct::weigh(scene, -path.ray.d, place, next);
        if constexpr (has(kMedia))
            if (any(place.collided))
                scatter_in_medium(scene, s, path, segment, place, random, next);
        advance(scene, path, place, next);
        end_here(scene, s, path, segment, place, e);
        if constexpr (has(kMedia)) {
            const F cosine = abs(dot(place.vertex.ng, path.ray.d));
            const F before = select(place.collided | place.pass, F(0.f), place.at.offset / cosine);
            Vertices::set_out(scene, s, path, segment + 1, before, e.alive);
        }
        return e;
    }

    // ---- end: absorption and roulette ----
    static VR_HD void end_here(const SceneView& scene, const PathSettings& s, PathState<L>& path,
                               uint32_t segment, const Place& place, Events<L>& e) {
        const M carries = max_channel(path.throughput) > F(0.f);
        const M scatters = place.scatters & carries;
        e.absorbed = e.absorbed | ((place.scatters | place.pass) & !carries);
        const M survivors = roulette(scene, s, path, segment, scatters);
        e.rr_killed = scatters & !survivors;
        e.alive = survivors | (place.pass & carries);
    }

    // The next ray, and all that the path carries along.
    static VR_HD void advance(const SceneView& scene, PathState<L>& path, const Place& place,
                              const BsdfSample<L>& next) {
        const Hit<L>& hit = place.hit;
        const Surface<L>& at = place.at;
        const Vertex& vertex = place.vertex;
        const M pass = place.pass;
        path.throughput = path.throughput * next.weight;
        if (uses(scene, kRefraction | kPass)) {
            const M through = next.transmitted | Vertices::crossing(place);
            if constexpr (has(kMedia)) path.medium = medium_beyond(scene, path, hit, at, through);
        }
        V from = vertex.p;
        if (uses(scene, kRefraction))
            from = select(next.transmitted, fma(vertex.ng, -at.offset, at.p), from);
        path.ray.o = select(pass, path.ray.o, from);
        if (uses(scene, kRefraction))
            path.scale = select(next.transmitted,
                                path.scale * (place.bsdf.view.relative * place.bsdf.view.relative),
                                path.scale);
        path.ray.d = next.wi;
        path.pdf_sa = select(pass, path.pdf_sa, next.pdf_sa);
        if constexpr (has(kManyLights)) path.facing = select(pass, path.facing, vertex.facing);
        if (uses(scene, kGoOn)) {
            path.travelled = select(pass, hit.t, F(0.f));
            path.passed = select(pass, hit.primitive, U(~0u));
            path.vertices = select(pass, path.vertices, path.vertices + U(1u));
        }
    }

    // ---- visible: a free shadow ray delivers ----
    static VR_HD void visible(PathState<L>& path, const ShadowRequest<L>& shadow, M free) {
        path.radiance = select(free, path.radiance + shadow.radiance, path.radiance);
    }

   private:
    // Lanes that may not scatter again.
    static VR_HD M beyond_depth(const SceneView& scene, const PathSettings& s,
                                const PathState<L>& path, uint32_t segment, M scatters) {
        if (segment + 1 >= kHardMaxDepth) return scatters;
        return deeper(scene, s.max_depth, path, segment, scatters);
    }
    // Those of the lanes whose paths have at least so many segments, passes not counted.
    static VR_HD M deeper(const SceneView& scene, uint32_t segments, const PathState<L>& path,
                          uint32_t segment, M lanes) {
        if (uses(scene, kGoOn)) return lanes & !(path.vertices + U(1u) < U(segments));
        return segment + 1 >= segments ? lanes : no_lanes(lanes);
    }
    // Takes from paths of few segments, in scenes that leave these out, the light that this one has
    // met.
    static VR_HD void mute(const SceneView& scene, PathState<L>& path, uint32_t segment, M active,
                           const S& before) {
        if (!scene.muted_segments) return;
        const M counts = deeper(scene, scene.muted_segments + 1, path, segment, active);
        path.radiance = select(active & !counts, before, path.radiance);
    }
};

}  // namespace veriray
