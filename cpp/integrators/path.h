// Unidirectional path tracing as stages on a path's state, which know no loop, queue or launch:
// schedulers own those. J. Kajiya 1986; E. Veach 1997 (multiple importance sampling, chapter 9).
// Next-event estimation and direction sampling are combined by the power heuristic with exponent 2.
// The constant environment has no light samples: sampled directions meet all of it alike. A segment
// is a ray from one surface or collision to the next; passes (null surfaces, uncovered parts of
// masks, thin glass) end a segment but are no vertices: depth, roulette and the density for the
// heuristic skip them.
#pragma once

#include "film/film.h"
#include "integrators/beside.h"
#include "integrators/direct.h"
#include "integrators/rims.h"

namespace veriray {

template <class L, uint32_t kFeatures>
struct PathTracer : DirectLight<L, kFeatures> {
    using Reader = SurfaceReader<L, kFeatures>;
    using Direct = DirectLight<L, kFeatures>;
    using Near = Beside<L, kFeatures>;
    using Direct::leave_closed, Direct::medium_beyond, Direct::medium_column,
        Direct::medium_spectrum, Direct::no_lanes, Direct::white, Direct::request,
        Direct::unblocked, Direct::black;
    using Reader::closest, Reader::has, Reader::material, Reader::surface_at,
        Reader::surface_column, Reader::surface_spectrum;
    using typename Direct::Sampler, typename Direct::Vertex;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V,
        typename Reader::S;
    using typename Reader::Material;
    using Lane = L;
    static constexpr uint32_t kMask = kFeatures;
    using State = PathState<L>;
    using Request = ShadowRequest<L>;
    template <uint32_t kOther>
    using With = PathTracer<L, kOther>;

    template <uint32_t kUse, class Path, class FloatField, class UintField>
    static VR_HD void each_field(Path& p, FloatField f, UintField u) {
        each_path_field<kFeatures, kUse>(p, f, u);
    }
    template <class Shadow, class FloatField, class UintField>
    static VR_HD void each_request_field(Shadow& s, FloatField f, UintField u) {
        each_shadow_field<kFeatures>(s, f, u);
    }
    static constexpr ColumnCount columns(uint32_t features) { return path_columns(features); }
    static constexpr ColumnCount request_columns(uint32_t features) {
        return shadow_columns(features);
    }
    static VR_HD Request no_request(M m) {
        const V nowhere{F(0.f), F(0.f), F(0.f)};
        return {no_lanes(m), {nowhere, nowhere}, F(0.f), black(), U(0u), U(0u), F(0.f), U(~0u)};
    }

    // ---- begin: a camera path through pixel (x, y) of a film `width` wide ----
    static VR_HD PathState<L> begin(const SceneView& scene, const PathSettings& s, U x, U y,
                                    uint32_t width, U sample) {
        PathState<L> path;
        path.pixel = y * U(width) + x;
        path.sample = sample;
        const Block<U> r = random_block(s.key, path.pixel, sample, dimension_block(0, kCamera));
        const F dx = F(0.5f) + filter_offset<L>(scene.filter, uniform(r.x));
        const F dy = F(0.5f) + filter_offset<L>(scene.filter, uniform(r.y));
        const V at = camera_point(scene.camera, to_float(x), to_float(y), dx, dy);
        path.ray = pinhole_ray<L>(scene.camera, at);
        if (scene.camera.before > 0.f)
            path.ray = far_ray<L>(scene.camera, to_float(x), to_float(y), dx, dy);
        if constexpr (has(kLens))
            if (scene.features & kLens)
                path.ray = lens_ray<L>(scene.camera, at, uniform(r.z), uniform(r.w));
        if constexpr (has(kClip)) {
            const F cosine = dot(path.ray.d, broadcast<F>(scene.camera.forward));
            path.ray.o = fma(path.ray.d, F(scene.camera.near_clip) / cosine, path.ray.o);
        }
        path.throughput = white();
        path.radiance = black();
        path.pdf_sa = F(0.f);
        path.scale = F(1.f);
        path.travelled = F(0.f);
        path.passed = U(~0u);
        path.vertices = U(0u);
        path.medium = U(scene.camera_medium);
        return path;
    }

    // ---- end: weight of the path's sample; all but signed filters weigh 1 ----
    static VR_HD F sample_weight(const SceneView& scene, const PathSettings& s,
                                 const PathState<L>& path) {
        if constexpr (!has(kSignedFilter)) return F(1.f);
        if (!(scene.features & kSignedFilter)) return F(1.f);
        const Block<U> r =
            random_block(s.key, path.pixel, path.sample, dimension_block(0, kCamera));
        const F dx = filter_offset<L>(scene.filter, uniform(r.x));
        const F dy = filter_offset<L>(scene.filter, uniform(r.y));
        return filter_weight(scene.filter, dx) * filter_weight(scene.filter, dy);
    }

    // ---- miss: the sky ----
    static VR_HD void miss(const SceneView& scene, PathState<L>& path, M escaped) {
        if constexpr (has(kSky)) {
            const auto weight = [&](LightPdf<F> pdf) {
                return mis_weight(path.pdf_sa, pdf.over / (pdf.under * path.pdf_sa));
            };
            add_radiance(path, escaped, Sampler::sky(Direct::sky_row(scene), path.ray.d, weight));
        }
    }

    // ---- cross: the medium between the ray's origin and its hit; returns the lanes that collide
    // before it ----
    static VR_HD M cross(const SceneView& scene, const PathSettings& s, PathState<L>& path,
                         Hit<L>& hit, F& flown, F far, uint32_t segment, M active) {
        M inside = active & !(path.medium == U(0u));
        leave_closed(scene, path, inside & !(hit.t < F(kInfinity)));
        inside = inside & !(path.medium == U(0u));
        if (none(inside)) return inside;
        const Block<U> r =
            random_block(s.key, path.pixel, path.sample, dimension_block(segment, kCross));
        const F limit = min(hit.t, far) - Reader::passed(path).t;
        const Flight<F> flight =
            free_flight(medium_spectrum(scene, path.medium, kMediumSigma),
                        medium_spectrum(scene, path.medium, kMediumAlbedo), path.throughput, limit,
                        uniform(r.y), r.x, has(kChromatic) && (scene.features & kChromatic) != 0);
        path.throughput = select(inside, path.throughput * flight.weight, path.throughput);
        flown = flight.t;
        const M collided = inside & (flight.t < limit);
        hit.t = select(collided, Reader::passed(path).t + flight.t, hit.t);
        return collided;
    }

    // ---- hit emitter: adds emission, returns the lanes that met an emitter's front ----
    static VR_HD M hit_emitter(const SceneView& scene, PathState<L>& path, const Hit<L>& hit,
                               const Surface<L>& at, M valid) {
        M lit = no_lanes(valid);
        if constexpr (has(kLamps)) {
            const U prim = select(valid, hit.primitive, U(0u));
            const F chance = lookup(scene.light_chance, prim, scene.primitive_count);
            lit = valid & at.front & (chance > F(0.f));
            if (any(lit)) {
                const F cos_light = -dot(at.ng, path.ray.d);
                // From the last vertex, where the direction was drawn.
                const LightPdf<F> pdf =
                    Direct::light_pdf(scene, prim, {path.ray.o, hit.t, cos_light, chance}, lit);
                const F ratio = pdf.over / (pdf.under * path.pdf_sa);
                const S emitted = surface_spectrum(scene, at.row, kSurfaceRadiance);
                add_radiance(path, lit, emitted * mis_weight(path.pdf_sa, ratio));
            }
        }
        return lit;
    }

    // ---- roulette: survive with q = min(1, max throughput), rounded up to a multiple of 2^-24 so
    // that the division is exact in expectation; returns the survivors ----
    static VR_HD M roulette(const PathSettings& s, PathState<L>& path, uint32_t segment, M active) {
        M plays = active;
        if constexpr (has(kPass))
            plays = plays & !(path.vertices < U(s.rr_depth));
        else if (segment + 1 < s.rr_depth)
            return active;
        F most = max_channel(path.throughput);
        if constexpr (has(kRefraction)) most = most * path.scale;
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

        using Rim = Rims<L, kFeatures>;
        if constexpr (has(kMedia)) hit = Rim::past_rims(scene, path.ray, hit, active);
        M valid = active & (hit.t < F(kInfinity)), collided = nobody;
        V collision = path.ray.o;
        const F far = far_end(scene, path, segment);
        if constexpr (has(kClip))
            if (has(kPass) || segment == 0) {
                valid = valid & (hit.t <= far);
                hit.t = select(valid, hit.t, F(kInfinity));
            }
        if constexpr (has(kMedia)) {
            const Hit<L> end = hit;
            F flown(0.f);
            collided = cross(scene, s, path, hit, flown, far, segment, active);
            e.collided = collided;
            if (any(collided)) collision = Near::collision_point(scene, path, flown, end, collided);
            valid = valid & !collided;
        }
        e.escaped = active & !(valid | collided);
        if (any(e.escaped)) miss(scene, path, e.escaped);
        if (none(valid | collided)) return e;

        // The surface, and which lanes it ends.
        Surface<L> at = surface_at(scene, path.ray, hit, valid);
        if constexpr (!has(kMedia)) {
            const M gone = Rim::leave_rims(scene, path.ray, far, hit, at, valid);
            if (any(gone)) miss(scene, path, gone);
            e.escaped = e.escaped | gone, valid = valid & !gone;
        }
        const M lit = hit_emitter(scene, path, hit, at, valid);
        Material bsdf = material(scene, at.row);
        const V wo = -path.ray.d;
        const F side = select(at.front, F(1.f), F(-1.f));
        Vertex vertex{fma(at.ng, at.offset * side, at.p), at.ng * side, at.ns * side, valid,
                      F(0.f)};
        F cos_o = dot(vertex.ns, wo);
        if constexpr (has(kSmooth)) Reader::face_viewer(bsdf, wo, vertex.ng, vertex.ns, cos_o);
        bsdf.set_view(vertex.ns, cos_o, at.front);
        M pass = nobody, covered = valid;
        if constexpr (has(kPass)) {
            const F opacity = surface_column(scene, at.row, kSurface_opacity);
            const M thin = valid & (opacity < F(1.f));
            if (any(thin)) {
                const U u =
                    random_block(s.key, path.pixel, path.sample, dimension_block(segment, kCross))
                        .z;
                pass = thin & !(uniform(u) < opacity);
                covered = valid & !pass;
            }
        }
        const M dark = covered & is_dark(scene, at, bsdf, cos_o);
        e.emitter_end = lit & dark;
        e.absorbed = dark & !e.emitter_end;
        M scatters = (covered & !dark) | collided;
        const M deep = beyond_depth(s, path, segment, scatters);
        if constexpr (!has(kPass)) {
            if (any(deep)) {
                e.depth_cut = deep;
                return e;
            }
        }
        if (none(scatters | pass)) return e;

        // Light samples, then the direction to go on.
        const Block<U> random =
            random_block(s.key, path.pixel, path.sample, dimension_block(segment, kScatter));
        if constexpr (has(kMedia)) {
            vertex.p = select(collided, collision, vertex.p);
            vertex.g = medium_column(scene, path.medium, kMediumG);
        }
        if constexpr (has(kAnyLight)) {
            const M receives = ((scatters & bsdf.scatters()) | collided) & !deep;
            if (scene.lights.count && any(receives))
                request(scene, s, path, vertex, bsdf, segment, random, receives, shadow);
        }
        U lobe(0u);
        if constexpr (Material::kChooses)
            lobe =
                random_block(s.key, path.pixel, path.sample, dimension_block(segment, kDecide)).z;
        BsdfSample<L> next = bsdf.sample(wo, {uniform(random.z), uniform(random.w), uniform(lobe)});
        if constexpr (has(kPass)) {
            next.pass = (next.pass & scatters & valid) | pass;
            next.transmitted = next.transmitted & !pass;
            next.wi = select(pass, path.ray.d, next.wi);
            next.weight = select(pass, white(), next.weight);
            pass = next.pass;
            e.depth_cut = scatters & deep & !pass;
            if (segment + 1 >= kHardMaxDepth) {
                e.depth_cut = e.depth_cut | pass;
                pass = nobody;
            }
            scatters = scatters & !(pass | e.depth_cut);
        }
        if constexpr (has(kSmooth)) {  // both normals must agree on the side
            const F up = dot(vertex.ng, next.wi);
            const M wrong =
                ((next.transmitted & (up > F(0.f))) | ((!next.transmitted) & (up < F(0.f)))) &
                !pass;
            if (any(wrong)) {
                next.weight = select(wrong, black(), next.weight);
                bsdf.sample_flat(next, wo, vertex.ng, at.front, wrong);
            }
        }
        if constexpr (has(kMedia)) {
            if (any(collided)) {
                next.wi = select(
                    collided,
                    henyey_greenstein(path.ray.d, vertex.g, uniform(random.z), uniform(random.w)),
                    next.wi);
                const F phase = henyey_greenstein_pdf(path.ray.d, next.wi, vertex.g);
                next.weight = select(collided, white(), next.weight);
                next.pdf_sa = select(collided, phase, next.pdf_sa);
                next.transmitted = next.transmitted & !collided;
            }
        }
        advance(scene, path, hit, at, vertex, bsdf, next, pass);

        const M black = scatters & !(max_channel(path.throughput) > F(0.f));
        e.absorbed = e.absorbed | black;
        scatters = scatters & !black;
        const M survivors = roulette(s, path, segment, scatters);
        e.rr_killed = scatters & !survivors;
        e.alive = survivors | pass;
        return e;
    }

    // The next ray, and all that the path carries along.
    static VR_HD void advance(const SceneView& scene, PathState<L>& path, const Hit<L>& hit,
                              const Surface<L>& at, const Vertex& vertex, const Material& bsdf,
                              const BsdfSample<L>& next, M pass) {
        path.throughput = path.throughput * next.weight;
        if constexpr (has(kRefraction | kPass)) {
            const M through = next.transmitted | pass;
            if constexpr (has(kMedia)) path.medium = medium_beyond(scene, path, at, through);
        }
        V from = vertex.p;
        if constexpr (has(kRefraction))
            from = select(next.transmitted, fma(vertex.ng, -at.offset, at.p), from);
        path.ray.o = select(pass, path.ray.o, from);
        if constexpr (has(kRefraction))
            path.scale = select(next.transmitted,
                                path.scale * (bsdf.view.relative * bsdf.view.relative), path.scale);
        path.ray.d = next.wi;
        path.pdf_sa = select(pass, path.pdf_sa, next.pdf_sa);
        if constexpr (has(kPass)) {
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
    // Power heuristic; 1 where no light sample competes.
    static VR_HD F mis_weight(F pdf, F ratio) {
        return select(pdf == F(0.f), F(1.f), F(1.f) / fma(ratio, ratio, F(1.f)));
    }
    static VR_HD void add_radiance(PathState<L>& path, M m, const S& radiance) {
        path.radiance = select(m, fma(path.throughput, radiance, path.radiance), path.radiance);
    }
    // Where the path's ray ends: a camera ray at the far plane.
    static VR_HD F far_end(const SceneView& scene, const PathState<L>& path, uint32_t segment) {
        if constexpr (!has(kClip)) return F(kInfinity);
        M camera = path.pdf_sa >= F(0.f);
        if constexpr (has(kPass))
            camera = path.vertices == U(0u);
        else if (segment)
            return F(kInfinity);
        const F cosine = dot(path.ray.d, broadcast<F>(scene.camera.forward));
        const F depth(scene.camera.far_clip - scene.camera.near_clip);
        return select(camera, depth / cosine, F(kInfinity));
    }
    // Reflects nothing: black, the back of a one-sided material, or seen from below the shading
    // normal's horizon.
    static VR_HD M is_dark(const SceneView& scene, const Surface<L>& at, const Material& bsdf,
                           F cos_o) {
        M dark = (!at.front) & (surface_column(scene, at.row, kSurfaceTwoSided) <= F(0.f));
        if constexpr (has(kSmooth)) dark = dark | !(cos_o > F(0.f));
        if constexpr (has(kPass)) dark = dark & !bsdf.only_passes();
        return dark | bsdf.black();
    }

    // Lanes that may not scatter again.
    static VR_HD M beyond_depth(const PathSettings& s, const PathState<L>& path, uint32_t segment,
                                M scatters) {
        if (segment + 1 >= kHardMaxDepth) return scatters;
        if constexpr (has(kPass))
            return scatters & !(path.vertices + U(1u) < U(s.max_depth));
        else
            return segment + 1 >= s.max_depth ? scatters : no_lanes(scatters);
    }
};

}  // namespace veriray
