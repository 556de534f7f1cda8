// Light samples at a vertex, and their shadow rays through media and passes.
#pragma once

#include "integrators/called.h"
#include "integrators/ray_media.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct DirectLight : RayMedia<L, kFeatures> {
    using Reader = SurfaceReader<L, kFeatures>;
    using Blend = Blends<L, kFeatures>;
    using Media = RayMedia<L, kFeatures>;
    using Blend::blend_weight, Blend::light_from, Blend::no_lanes, Blend::other_row;
    using Media::attenuate, Media::medium_beyond;
    using Reader::closest, Reader::has, Reader::material, Reader::occluded, Reader::passed,
        Reader::surface_at, Reader::surface_column, Reader::uses;
    using typename Blend::Answer, typename Blend::Place, typename Blend::Vertex;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V,
        typename Reader::S;
    using typename Reader::Material;

    using Sampler = Lights<L, shapes_of(kFeatures), has(kRefraction | kPass | kMedia)>;

    // What of a vertex the choice of a light depends on, but for its place.
    static VR_HD U facing_of(const SceneView& scene, V wo, const Place& place) {
        const V any{F(0.f), F(0.f), F(1.f)};
        Vertex at = place.vertex;
        M both = no_lanes(at.surface);
        if constexpr (Material::kTransmits) both = place.bsdf.transmits();
        if constexpr (has(kBlend)) Blend::face_all(scene, wo, place, at.ns, both);
        const U sides = select(both, U(kBothSides), U(kOneSide));
        return select(at.surface, facing(select(at.surface, at.ns, any), sides), U(kAllSides));
    }

    static VR_HD S black() { return S::all(F(0.f)); }
    static VR_HD S white() { return S::all(F(1.f)); }

    // ---- light sample: one light as seen from a vertex, whose point itself is `point` ----
    static VR_HD LightSample<L> sample_light(const SceneView& scene, const PathSettings& s,
                                             const PathState<L>& path, const Vertex& at, V point,
                                             uint32_t segment, Block<U> scatter, M active) {
        const LightView& lights = scene.lights;
        const F u = uniform(scatter.x), v = uniform(scatter.y);
        const M nobody = no_lanes(active);
        U row(0u);
        F chance(1.f);
        if (has(kManyLights) && lights.count > 1) {
            const U u24 =
                random_block(s.key, path.pixel, path.sample, dimension_block(segment, kDecide)).x >>
                8;
            RandomStream<U> random{U(0u), U(0u), U(0u)};
            if (lights.count > kMostBranches)
                random = random_stream(s.key, path.pixel, path.sample,
                                       dimension_block(segment, kDecide, kLightSteps));
            const auto choice =
                LightTree<L>::choose(lights.tree, {at.p, at.facing}, u24, random, active);
            row = choice.row, chance = choice.chance;
        }
        LightSample<L> light = Sampler::sample_li(row_of(scene, row), point, at.p, u, v, nobody);
        if (has(kManyLights) && lights.count > 1) light.inverse_pdf = light.inverse_pdf / chance;
        if constexpr (has(kLightTextures))
            if (scene.features & kLightTextures)
                apply_texture(scene, row_of(scene, row), active, light);
        return light;
    }

    // Multiplies the radiance of a light by its texture.
    template <class Row>
    static VR_HD void apply_texture(const SceneView& scene, const Row& row, M active,
                                    LightSample<L>& light) {
        const F index = row(kLightTexture);
        const M lanes = active & (index >= F(0.f)) & (max_channel(light.radiance) > F(0.f));
        if (none(lanes)) return;
        TexturePoint<L> at;
        at.u = at.v = F(0.f);
        if constexpr (has(kAttributes))
            at.p = Sampler::point(row, light.place), at.primitive = light.on;
        Sampler::image(row, light.wi, at.u, at.v);
        const M lamp = lanes & Sampler::template any_of<kLampShapes>(row, no_lanes(lanes));
        if (any(lamp)) {
            const auto outward = [&] { return light.place; };
            const TexturePoint<L> own = Reader::Texturing::template place<kFeatures>(
                scene, select(lamp, light.on, U(0u)), light.place, outward);
            at.u = select(lamp, own.u, at.u);
            at.v = select(lamp, own.v, at.v);
        }
        Reader::Texturing::multiply(scene, index, at, lanes, light.radiance);
    }

    static VR_HD auto row_of(const SceneView& scene, U row) {
        return light_row<L>(
            [&scene, row](uint32_t c) VR_INLINED {
                const float* column = scene.lights.table + c * scene.lights.stride;
                if constexpr (has(kManyLights)) return lookup(column, row, scene.lights.count);
                return F(*column);
            },
            scene.lights.map);
    }
    static VR_HD auto sky_row(const SceneView& scene) {
        return light_row<L>([&scene](uint32_t c) VR_INLINED { return F(scene.lights.sky[c]); },
                            scene.lights.map);
    }

    // The chance with which a light was chosen at a path's last scattering.
    static VR_HD F chance(const SceneView& scene, const PathState<L>& path, U leaf, M lanes) {
        if (!has(kManyLights) || scene.lights.count <= 1) return F(1.f);
        return LightTree<L>::chance(scene.lights.tree, {path.ray.o, path.facing},
                                    select(lanes, leaf, U(0u)), lanes);
    }

    // The density of light samples where a path's ray meets a lamp.
    static VR_HD LightPdf<F> light_pdf(const SceneView& scene, const PathState<L>& path,
                                       U primitive, const LightHit<L>& at, M lanes) {
        LightPdf<F> pdf = at.by_area();
        if constexpr (has(kOwnPdfLights | kManyLights))
            if (scene.light_row) {
                const U row = to_uint(lookup(scene.light_row, primitive, scene.primitive_count));
                if constexpr (has(kOwnPdfLights))
                    if (scene.features & kOwnPdfLights) {
                        pdf = Sampler::pdf_li(row_of(scene, row), at, lanes);
                        // The row of a lamp that is not sampled is another one's.
                        pdf.over = select(at.chance > F(kNotSampled), pdf.over, F(0.f));
                    }
                const M competes = lanes & (path.pdf_sa > F(0.f));
                if (has(kManyLights) && scene.lights.count > 1 && any(competes))
                    pdf.over = pdf.over * chance(scene, path,
                                                 as_uint(row_of(scene, row)(kLightLeaf)), competes);
            }
        return pdf;
    }

    // ---- request: what the light sample would add, as a shadow ray. Of blends, weighs the next
    // direction, too, which has been drawn ----
    static VR_HD void request(const SceneView& scene, const PathSettings& s,
                              const PathState<L>& path, const Place& place, uint32_t segment,
                              Block<U> scatter, M active, [[maybe_unused]] BsdfSample<L>& next,
                              ShadowRequest<L>& shadow) {
        const Vertex& at = place.vertex;
        V point = place.at.p;
        if constexpr (has(kMedia)) point = select(at.surface, point, at.p);
        const LightSample<L> light =
            sample_light(scene, s, path, at, point, segment, scatter, active);
        Answer found = light_from(light.wi, -path.ray.d, at, place.bsdf, active);
        if constexpr (has(kBlend))
            Blend::mix(scene, -path.ray.d, place, light.wi, active & place.choice.mixed, found,
                       next);
        BsdfValue<F>& value = found.value;
        M &lit = found.lit, &behind = found.behind;
        if constexpr (has(kMedia)) {
            const auto phase =
                at.phase.eval(scene.phases, path.ray.d, light.wi, active & !at.surface);
            value.f_cos = select(at.surface, value.f_cos, S::all(phase.value));
            value.pdf_sa = select(at.surface, value.pdf_sa, phase.pdf_sa);
            lit = (lit & at.surface) | (active & !at.surface);
        }
        // Power heuristic.
        const F ratio = value.pdf_sa * light.inverse_pdf;
        F weight = light.inverse_pdf / fma(ratio, ratio, F(1.f));
        if constexpr (has(kDeltaLights)) weight = select(light.delta, light.inverse_pdf, weight);
        // From nearer than 2^-64 the inverse overflows; its weight would be 0.
        lit = lit & (light.inverse_pdf < F(kInfinity));
        shadow.wanted = lit & (max_channel(light.radiance) > F(0.f));
        shadow.ray = {at.p, light.aim};
        shadow.t_max = light.distance;
        shadow.radiance = path.throughput * light.radiance * value.f_cos * weight;
        shadow.skip = light.skip;
        if constexpr (has(kMedia)) shadow.medium = path.medium;
        if constexpr (has(kUnevenMedia))
            shadow.random = random_stream(s.key, path.pixel, path.sample,
                                          dimension_block(segment, kCross, kShadowSteps));
        shadow.travelled = F(0.f), shadow.passed = U(~0u);
        if constexpr (Material::kTransmits)
            if (any(behind)) shadow.wanted = shadow.wanted & start_behind(at, behind, shadow);
    }

    // Lanes at collisions whose light samples do not arrive, whatever is on the way: their rays are
    // not wanted.
    static VR_HD M shut_in(const SceneView& scene, const PathState<L>& path, M collided,
                           ShadowRequest<L>& shadow) {
        if (!scene.shut_media) return no_lanes(collided);
        const M shut = shadow.wanted & collided &
                       (Media::medium_column(scene, path.medium, kMediumShut) > F(0.f));
        shadow.wanted = shadow.wanted & !shut;
        return shut;
    }

    // From the other side of the surface to the same point, or the same way if that is far away.
    // False where the point is not beyond that side: it is on the surface, which does not light
    // itself.
    static VR_HD M start_behind(const Vertex& at, M lanes, ShadowRequest<L>& shadow) {
        const V ahead = fma(shadow.ray.d, shadow.t_max, at.p - at.behind);
        const F distance = sqrt(dot(ahead, ahead));
        const M near = lanes & (distance < F(kInfinity));
        shadow.ray.o = select(lanes, at.behind, shadow.ray.o);
        shadow.ray.d = select(near, ahead * (F(1.f) / distance), shadow.ray.d);
        shadow.t_max = select(near, distance * F(kShadowShorten), shadow.t_max);
        if constexpr (has(kMedia)) shadow.medium = select(lanes, at.beyond, shadow.medium);
        return !near | (dot(at.ng, ahead) < F(0.f));
    }

    // Whether shadow rays continue behind surfaces that let them through.
    static VR_HD bool shadows_pass(const SceneView& scene) {
        return has(kPass) && (scene.features & kPass);
    }

    // ---- shadow: the lanes whose light arrives, attenuated by media and passes ----
    static VR_HD M unblocked(const SceneView& scene, ShadowRequest<L>& shadow) {
        if (!shadows_pass(scene)) {
            const M free = shadow.wanted & !occluded(scene, shadow);
            if constexpr (has(kMedia)) attenuate(scene, shadow, shadow.t_max, free);
            return free;
        }
        M todo = shadow.wanted, free = no_lanes(todo);
        while (any(todo))
            free = free | shadow_hit(scene, shadow,
                                     Reader::next_hit(scene, shadow, shadow.t_max, todo), todo);
        return free;
    }

    // For shadow rays that pass surfaces: attenuates by the hit. Returns the lanes whose light has
    // arrived; those that go on remain in todo.
    static VR_HD M shadow_hit(const SceneView& scene, ShadowRequest<L>& shadow, const Hit<L>& hit,
                              M& todo) {
        M met = todo & (hit.t < shadow.t_max);
        met = met & !(hit.primitive == shadow.skip);
        if constexpr (has(kMedia)) attenuate(scene, shadow, hit.t - shadow.travelled, todo);
        const M free = todo & !met;
        todo = met;
        if (none(todo)) return free;
        Surface<L> at = surface_at(scene, shadow.ray, hit, todo);
        S share = let_through(scene, shadow.ray, hit.primitive, at, todo);
        if constexpr (has(kBlend)) {
            M blended = no_lanes(todo);
            const U row = at.row;
            U next = row;
            if (scene.features & kBlend) next = other_row(scene, at, todo, blended);
            S one = share, sum = S::all(F(0.f));  // of this row; of those before, by their chances
            F left = F(1.f);                      // chance of the rows behind
            while (any(blended)) {
                const F weight = blend_weight(scene, at);
                sum = fma(one, left * (F(1.f) - weight), sum);
                left = left * weight;
                at.row = next;
                one = let_through(scene, shadow.ray, hit.primitive, at, blended);
                M more;
                next = other_row(scene, at, blended, more);
                share = select(blended & !more, fma(one, left, sum), share);
                blended = more;
            }
            at.row = row;
        }
        shadow.radiance = select(todo, shadow.radiance * share, shadow.radiance);
        // A ray that roulette has ended in an uneven medium still says what blocks it.
        const bool uneven = has(kUnevenMedia) && (scene.features & kUnevenMedia);
        todo = todo & (max_channel(uneven ? share : shadow.radiance) > F(0.f));
        if constexpr (has(kMedia)) shadow.medium = medium_beyond(scene, shadow, hit, at, todo);
        shadow.travelled = select(todo, hit.t, shadow.travelled);
        shadow.passed = select(todo, hit.primitive, shadow.passed);
        return free;
    }

    // The share of light that goes straight through a surface.
    static VR_HD S let_through(const SceneView& scene, const Ray<L>& ray, U primitive,
                               const Surface<L>& at, M lanes) {
        Material bsdf = material(scene, at);
        const F side = select(at.front, F(1.f), F(-1.f));
        V ns = at.ns * side;
        F cosine;
        Blend::look(scene, primitive, at, -ray.d, at.ng * side, lanes, bsdf, ns, cosine);
        const F opacity = DirectLight::opacity(scene, at);
        return fma(bsdf.pass_through(), opacity, S::all(F(1.f) - opacity));
    }
};

}  // namespace veriray
