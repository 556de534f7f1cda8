// Where the segments of a path end, as stages: nowhere, at a surface, or at a collision in a
// medium; the light that is met there, and the next direction.
#pragma once

#include "integrators/beside.h"
#include "integrators/direct.h"
#include "integrators/rims.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct PathVertices : DirectLight<L, kFeatures> {
    using Reader = SurfaceReader<L, kFeatures>;
    using Direct = DirectLight<L, kFeatures>;
    using Near = Beside<L, kFeatures>;
    using Rim = Rims<L, kFeatures>;
    using Direct::leave_closed, Direct::medium_column, Direct::medium_spectrum, Direct::no_lanes,
        Direct::white, Direct::black;
    using Reader::has, Reader::uses, Reader::material, Reader::surface_at, Reader::surface_column,
        Reader::surface_spectrum;
    using typename Direct::Place, typename Direct::Sampler, typename Direct::Vertex;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V,
        typename Reader::S;
    using typename Reader::Material;

    // ---- miss: the sky ----
    static VR_HD void miss(const SceneView& scene, PathState<L>& path, M escaped) {
        if constexpr (has(kHidden)) escaped = escaped & !unseeing(scene, path);
        if constexpr (has(kSky)) {
            const auto weight = [&](LightPdf<F> pdf) {
                const U leaf = as_uint(Direct::sky_row(scene)(kLightLeaf));
                pdf.over = pdf.over * Direct::chance(scene, path, leaf, escaped);
                return mis_weight(path.pdf_sa, pdf.over / (pdf.under * path.pdf_sa));
            };
            add_radiance(path, escaped,
                         Sampler::sky(Direct::sky_row(scene), path.ray.d, path.ray.o, weight));
        }
    }

    // ---- cross: the medium between the ray's origin and its hit; returns the lanes that collide
    // before it ----
    static VR_HD M cross(const SceneView& scene, const PathSettings& s, PathState<L>& path,
                         Hit<L>& hit, F& flown, F far, uint32_t segment, M active) {
        M inside = active & !(path.medium == U(0u));
        if (none(inside)) return inside;
        const M endless = inside & !(hit.t < F(kInfinity));
        if (any(endless)) {
            const U before = path.medium;
            leave_closed(scene, path, endless);
            const M left = endless & !(path.medium == before);
            if (any(left)) set_out(scene, s, path, segment, F(0.f), left);
            inside = inside & !(path.medium == U(0u));
            if (none(inside)) return inside;
        }
        const F limit = min(hit.t, far) - Reader::passed(path).t;
        flown = path.flight;
        S weight = flight_weight(Direct::extinction(scene, path.medium, path.ray.d),
                                 medium_spectrum(scene, path.medium, kMediumAlbedo),
                                 path.throughput, flown, limit, chromatic(scene));
        if constexpr (has(kUnevenMedia))
            if (scene.features & kUnevenMedia)
                cross_uneven(scene, s, path, limit, segment, inside, flown, weight);
        path.throughput = select(inside, path.throughput * weight, path.throughput);
        const M collided = inside & (flown < limit);
        hit.t = select(collided, Reader::passed(path).t + flown, hit.t);
        return collided;
    }

    // ---- set out: the free flight of rays that begin segment `segment`; infinite in the vacuum
    // and in uneven media, where it is sampled on the way. before: how far rays have come in the
    // medium where they begin, beyond the surface's rounding. Who collides there does so at once;
    // that is off by the square of its optical depth ----
    static VR_HD void set_out(const SceneView& scene, const PathSettings& s, PathState<L>& path,
                              uint32_t segment, F before, M lanes) {
        path.flight = select(lanes, F(kInfinity), path.flight);
        M inside = lanes & !(path.medium == U(0u));
        if constexpr (has(kUnevenMedia))
            if (scene.features & kUnevenMedia)
                inside = inside & !Direct::uneven_medium(scene, path.medium);
        if (none(inside)) return;
        const Block<U> r =
            random_block(s.key, path.pixel, path.sample, dimension_block(segment, kCross));
        const V d = path.ray.d;
        const S sigma = Direct::extinction(scene, path.medium, d);
        const F flight = free_flight(sigma, path.throughput, uniform(r.y), r.x, chromatic(scene));
        const F come = min(before, flight);
        if (chromatic(scene)) {  // at less than that, the weights round to 1
            const M dense = inside & (come * max_channel(sigma) > F(0x1p-25f));
            if (any(dense)) {
                const S arrived =
                    flight_weight(sigma, white(), path.throughput, F(kInfinity), come, true);
                path.throughput = select(dense, path.throughput * arrived, path.throughput);
            }
        }
        path.flight = select(inside, flight - come, path.flight);
    }
    static VR_HD bool chromatic(const SceneView& scene) {
        return has(kChromatic) && (scene.features & kChromatic) != 0;
    }

    // The albedo at collisions in media where a grid gives it.
    static VR_HD void scatter_by_grid(const SceneView& scene, PathState<L>& path, V at,
                                      M collided) {
        const F row = medium_column(scene, path.medium, kMediumAlbedoGrid);
        const M given = collided & (row >= F(0.f));
        if (none(given)) return;
        const U grid = to_uint(select(given, row, F(0.f)));
        const S albedo = Grids<L>::value(scene.grids, Grids<L>::grid(scene.grids, grid),
                                         Grids<L>::local(scene.grids, grid, at, 1.f), given);
        path.throughput = select(given, path.throughput * albedo, path.throughput);
    }

    // The flights of lanes whose medium's extinction is uneven.
    static VR_HD void cross_uneven(const SceneView& scene, const PathSettings& s,
                                   PathState<L>& path, F limit, uint32_t segment, M inside,
                                   F& flown, S& weight) {
        const M uneven = inside & Direct::uneven_medium(scene, path.medium);
        if (none(uneven)) return;
        const RandomStream<U> random = random_stream(
            s.key, path.pixel, path.sample, dimension_block(segment, kCross, kFlightSteps));
        S throughput = path.throughput;  // a copy, so that the path stays in registers
        F sigma = medium_column(scene, path.medium, kMediumSigma);
        if (Direct::has_flakes(scene))
            sigma = sigma * Direct::met_along(scene, path.medium, path.ray.d);
        const F t = Volumes<L>::flight(scene, Direct::passage(scene, path, limit, uneven), sigma,
                                       random, throughput, chromatic(scene), uneven);
        path.throughput = throughput;
        flown = select(uneven, t, flown);
        const S albedo = medium_spectrum(scene, path.medium, kMediumAlbedo);
        weight = select(uneven, select(t < limit, albedo, white()), weight);
    }

    // ---- hit emitter: adds emission, returns the lanes that met an emitter's front ----
    static VR_HD M hit_emitter(const SceneView& scene, PathState<L>& path, const Hit<L>& hit,
                               const Surface<L>& at, M valid) {
        M lit = no_lanes(valid);
        if (uses(scene, kLamps)) {
            const U prim = select(valid, hit.primitive, U(0u));
            const F chance = lookup(scene.light_chance, prim, scene.primitive_count);
            lit = valid & at.front & (chance > F(0.f));
            if (any(lit)) {
                const F cos_light = -dot(at.ng, path.ray.d);
                // From the last vertex, where the direction was drawn.
                const LightPdf<F> pdf = Direct::light_pdf(
                    scene, path, prim, {path.ray.o, hit.t, cos_light, chance}, lit);
                const F ratio = pdf.over / (pdf.under * path.pdf_sa);
                S emitted = surface_spectrum(scene, at.row, kSurfaceRadiance);
                if constexpr (has(kLightTextures))
                    if (scene.features & kLightTextures) {
                        const F index = surface_column(scene, at.row, kSurfaceRadianceTexture);
                        Reader::Texturing::multiply(scene, index, at.uv, lit, emitted);
                    }
                add_radiance(path, lit, emitted * mis_weight(path.pdf_sa, ratio));
            }
        }
        return lit;
    }

    // Where the path's ray ends: a camera ray at the far plane.
    static VR_HD F far_end(const SceneView& scene, const PathState<L>& path, uint32_t segment) {
        if constexpr (!has(kClip)) return F(kInfinity);
        if (!(scene.camera.far_clip < kInfinity)) return F(kInfinity);
        M camera = path.pdf_sa >= F(0.f);
        if (uses(scene, kGoOn))
            camera = path.vertices == U(0u);
        else if (segment)
            return F(kInfinity);
        const F cosine = dot(path.ray.d, broadcast<F>(scene.camera.forward));
        const F depth(scene.camera.far_clip - scene.camera.near_clip);
        return select(camera, depth / cosine, F(kInfinity));
    }

    // ---- arrive: what ends the segment. Returns the lanes at a surface; those of place.collided
    // are at a collision, the others have escaped ----
    static VR_HD M arrive(const SceneView& scene, const PathSettings& s, PathState<L>& path, F far,
                          uint32_t segment, M active, Place& place, Events<L>& e) {
        Hit<L>& hit = place.hit;
        if constexpr (has(kMedia)) hit = Rim::past_rims(scene, path.ray, hit, active);
        M valid = active & (hit.t < F(kInfinity));
        place.collided = no_lanes(active);
        V collision = path.ray.o;
        if constexpr (has(kClip))
            if (has(kPass) || segment == 0) valid = valid & (hit.t <= far);
        if constexpr (has(kMedia)) {
            const Hit<L> end = hit;
            F flown(0.f);
            place.collided = e.collided = cross(scene, s, path, hit, flown, far, segment, active);
            if (any(e.collided))
                collision = Near::collision_point(scene, path, flown, end, e.collided);
            if constexpr (has(kAlbedoGrids))
                if (scene.features & kAlbedoGrids)
                    scatter_by_grid(scene, path, collision, e.collided);
            valid = valid & !e.collided;
        }
        e.escaped = active & !(valid | place.collided);
        if (any(e.escaped)) miss(scene, path, e.escaped);
        place.vertex.p = collision;
        return valid;
    }

    // ---- reach: the surface there; lanes that rims let go on to nothing leave `valid` ----
    static VR_HD void reach(const SceneView& scene, PathState<L>& path, F far, M& valid,
                            Place& place, Events<L>& e) {
        place.at = surface_at(scene, path.ray, place.hit, valid);
        if constexpr (!has(kMedia)) {
            const M gone = Rim::leave_rims(scene, path.ray, far, place.hit, place.at, valid);
            if (any(gone)) miss(scene, path, gone);
            e.escaped = e.escaped | gone, valid = valid & !gone;
        }
    }

    // ---- surface vertex: emission, the material as seen along the ray, and which lanes end ----
    static VR_HD void surface_vertex(const SceneView& scene, const PathSettings& s,
                                     PathState<L>& path, uint32_t segment, M valid, Place& place,
                                     Events<L>& e) {
        if constexpr (has(kBlend))
            Direct::choose_material(scene, s, path, segment, valid, place.at, place.choice);
        const Surface<L>& at = place.at;
        M covered = valid;
        place.hidden = no_lanes(valid);
        if (uses(scene, kHidden)) {
            place.hidden = hidden_lamp(scene, path, place.hit, valid);
            covered = valid & !place.hidden;
        }
        const M lit = hit_emitter(scene, path, place.hit, at, covered);
        place.bsdf = material(scene, at);
        const V wo = -path.ray.d, collision = place.vertex.p;
        const F side = select(at.front, F(1.f), F(-1.f));
        place.vertex = {fma(at.ng, at.offset * side, at.p),
                        at.ng * side,
                        at.ns * side,
                        valid,
                        {},
                        U(0u),
                        U(0u),
                        {}};
        Vertex& vertex = place.vertex;
        if constexpr (Material::kTransmits) {
            vertex.behind = fma(at.ng, -at.offset * side, at.p);
            if constexpr (has(kMedia))
                vertex.beyond = Direct::medium_beyond(scene, path, place.hit, at, valid);
        }
        F cos_o;
        Direct::look(scene, place.hit.primitive, at, wo, vertex.ng, valid, place.bsdf, vertex.ns,
                     cos_o);
        place.pass = no_lanes(valid);
        if constexpr (has(kHidden)) place.pass = place.hidden;
        if constexpr (has(kBlend)) place.choice.mixed = place.choice.mixed & covered;
        if (uses(scene, kPass)) {
            const F opacity = Direct::opacity(scene, at);
            const M thin = covered & (opacity < F(1.f));
            if (any(thin)) {
                const U u =
                    random_block(s.key, path.pixel, path.sample, dimension_block(segment, kCross))
                        .z;
                place.pass = place.pass | (thin & !(uniform(u) < opacity));
                covered = valid & !place.pass;
            }
        }
        M dark = covered & is_dark(scene, at, place.bsdf, cos_o);
        if constexpr (has(kBlend))
            if (any(place.choice.mixed)) {  // what is black in a blend sends paths on for the rest
                Direct::show(scene, at, place.bsdf, cos_o, place.choice);
                dark = dark & (place.choice.away | !place.choice.mixed);
            }
        e.emitter_end = lit & dark;
        e.absorbed = dark & !e.emitter_end;
        place.scatters = (covered & !dark) | place.collided;
        if constexpr (has(kMedia)) {
            vertex.p = select(place.collided, collision, vertex.p);
            vertex.phase = Direct::phase_function(scene, path.medium);
        }
    }

    // ---- surface vertex: the next direction. Lanes that pass leave `scatters` ----
    static VR_HD BsdfSample<L> scatter_at_surface(const SceneView& scene, const PathSettings& s,
                                                  const PathState<L>& path, uint32_t segment,
                                                  Block<U> random, M deep, M valid, Place& place,
                                                  Events<L>& e) {
        const V wo = -path.ray.d;
        U lobe(0u);
        if constexpr (Material::kChooses)
            lobe =
                random_block(s.key, path.pixel, path.sample, dimension_block(segment, kDecide)).z;
        BsdfSample<L> next =
            place.bsdf.sample(wo, {uniform(random.z), uniform(random.w), uniform(lobe)});
        if (uses(scene, kGoOn)) {
            next.pass = (next.pass & place.scatters & valid) | place.pass;
            next.transmitted = next.transmitted & !place.pass;
            next.wi = select(place.pass, path.ray.d, next.wi);
            next.weight = select(place.pass, white(), next.weight);
            place.pass = next.pass;
            e.depth_cut = place.scatters & deep & !place.pass;
            if (segment + 1 >= kHardMaxDepth) {
                e.depth_cut = e.depth_cut | place.pass;
                place.pass = no_lanes(deep);
            }
            place.scatters = place.scatters & !(place.pass | e.depth_cut);
        }
        if (uses(scene, kSmooth)) {  // both normals must agree on the side
            const F up = dot(place.vertex.ng, next.wi);
            if constexpr (Material::kEitherSide) {  // the face says on which
                const M either = place.bsdf.either_side() & !place.pass;
                next.transmitted = (either & (up < F(0.f))) | (next.transmitted & !either);
            }
            const M wrong =
                ((next.transmitted & (up > F(0.f))) | ((!next.transmitted) & (up < F(0.f)))) &
                !place.pass;
            if (any(wrong))
                place.bsdf.sample_flat(next, wo, place.vertex.ng, place.at.front, wrong);
        }
        return next;
    }

    // ---- medium vertex: the next direction of lanes that have collided ----
    static VR_HD void scatter_in_medium(const SceneView& scene, const PathSettings& s,
                                        const PathState<L>& path, uint32_t segment,
                                        const Place& place, Block<U> random, BsdfSample<L>& next) {
        const M collided = place.collided;
        const auto& phase = place.vertex.phase;
        const bool lobes = has(kPhases) && scene.phases.most;
        F choice(0.f);
        if (lobes)
            choice = uniform(
                random_block(s.key, path.pixel, path.sample, dimension_block(segment, kCross)).w);
        const V wi = phase.sample(scene.phases, path.ray.d, choice, uniform(random.z),
                                  uniform(random.w), collided);
        next.wi = select(collided, wi, next.wi);
        const auto drawn = phase.eval(scene.phases, path.ray.d, next.wi, collided);
        S weight = white();
        if (lobes)  // at a table's zeros, which rounding alone reaches, none
            weight = S::all(select(drawn.pdf_sa > F(0.f), drawn.value / drawn.pdf_sa, F(0.f)));
        next.weight = select(collided, weight, next.weight);
        next.pdf_sa = select(collided, drawn.pdf_sa, next.pdf_sa);
        next.transmitted = next.transmitted & !collided;
    }

    // Those of the lanes that pass through a surface for which its media change.
    static VR_HD M crossing(const Place& place) {
        if constexpr (has(kHidden)) return place.pass & !place.hidden;
        return place.pass;
    }

    // Rays of the camera, on the way to their first scattering, which do not see light.
    static VR_HD M unseeing(const SceneView& scene, const PathState<L>& path) {
        static_assert(!has(kHidden) || has(kPass));
        const M camera = path.vertices == U(0u);
        return scene.features & kHidden ? camera : no_lanes(camera);
    }
    static VR_HD M hidden_lamp(const SceneView& scene, const PathState<L>& path, const Hit<L>& hit,
                               M valid) {
        const M unseen = valid & unseeing(scene, path);
        if (none(unseen)) return unseen;
        const U met = select(unseen, hit.primitive, U(0u));
        return unseen & !(lookup(scene.light_chance, met, scene.primitive_count) == F(0.f));
    }
    static VR_HD M is_dark(const SceneView& scene, const Surface<L>& at, const Material& bsdf,
                           F cos_o) {
        return Direct::looks_away(scene, at, bsdf, cos_o) | bsdf.black();
    }

   private:
    // Power heuristic; 1 where no light sample competes.
    static VR_HD F mis_weight(F pdf, F ratio) {
        return select(pdf == F(0.f), F(1.f), F(1.f) / fma(ratio, ratio, F(1.f)));
    }
    static VR_HD void add_radiance(PathState<L>& path, M m, const S& radiance) {
        path.radiance = select(m, fma(path.throughput, radiance, path.radiance), path.radiance);
    }
};

}  // namespace veriray
