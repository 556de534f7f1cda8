// Surfaces as paths see them, and blends, in which a hit is of several materials.
//
// Of a blend a random number chooses the material that draws a path's next direction. If the lobe
// that it selects is not a delta lobe, all materials weigh the direction, each by its share: the
// balance heuristic for one sample (E. Veach, 1997, section 9.2.4). Values and densities are those
// of `eval`, which have the selection of lobes in them, so materials that are delta lobes in part
// need nothing more. Light samples count for all materials, whichever is chosen, also where it lets
// the path pass. Each is seen with its own normal, sides and opacity.
#pragma once

#include "integrators/surface.h"
#include "integrators/tangents.h"
#include "media/phase.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct Blends : SurfaceReader<L, kFeatures> {
    using Reader = SurfaceReader<L, kFeatures>;
    using Reader::has, Reader::material, Reader::surface_column, Reader::uses;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V,
        typename Reader::S;
    using typename Reader::Material;
    using Along = Tangents<L>;
    using PhaseFunction = Phase<L, has(kPhases)>;

    // A vertex: where and how light is scattered.
    struct Vertex {
        V p;        // shadow rays start here
        V ng, ns;   // on wo's side; surfaces only
        M surface;  // else a collision in a medium
        V behind;   // with kTransmits: where shadow rays to the other side of a surface start,
        U beyond;   // and the medium there
        U facing;   // with kManyLights
        PhaseFunction phase;  // with kMedia
    };

    // The choice of one of a blend's materials.
    struct Choice {
        M mixed;  // lanes where more than one had a chance
        U first;  // the row of the first one
        F share;  // of the chosen one, where it covers the surface
        M away;   // lanes where that looks away
    };

    // Where a path scatters: at a surface, or at a collision in a medium.
    struct Place {
        Hit<L> hit;
        Surface<L> at;
        Vertex vertex;
        Material bsdf;
        M collided, scatters;  // of these, in a medium; all
        M pass;                // goes on straight through the surface
        M hidden;              // kHidden: of these, lamps, which are not there for the camera
        Choice choice;         // kBlend: of the material
    };

    static VR_HD M no_lanes(M m) { return m & !m; }

    // A number of the material that a texture may give.
    static VR_HD F number(const SceneView& scene, const Surface<L>& at, SurfaceColumn c,
                          SurfaceColumn texture) {
        const auto column = [&](uint32_t k) VR_INLINED { return surface_column(scene, at.row, k); };
        if constexpr (has(kTextures))
            return Reader::Texturing::number(scene, column, c, texture, at.uv);
        return column(c);
    }
    static VR_HD F opacity(const SceneView& scene, const Surface<L>& at) {
        return number(scene, at, kSurface_opacity, kSurface_opacity_texture);
    }

    // Looks at a surface's material along wo. ng, ns: on wo's side; a texture may turn ns.
    static VR_HD void look(const SceneView& scene, U primitive, const Surface<L>& at, V wo, V ng,
                           M lanes, Material& bsdf, V& ns, F& cos_o) {
        [[maybe_unused]] typename Along::Partials along;
        if constexpr (has(kTangents))
            if (scene.tangents) {
                along = Along::template partials<Reader>(scene, primitive, at, lanes);
                Along::template relieve<Reader>(scene, along, at, wo, lanes, bsdf, ns);
            }
        cos_o = dot(ns, wo);
        if constexpr (has(kSmooth)) Reader::face_viewer(bsdf, wo, ng, ns, cos_o);
        bsdf.set_view(ns, cos_o, at.front);
        if constexpr (has(kTangents))
            if (scene.tangents) {
                bsdf.view.tangents = true;
                bsdf.view.tangent = Along::across(Along::across(along.u, at.ns), ns);
            }
    }
    // The back of a one-sided material, or seen from below the shading normal's horizon.
    static VR_HD M looks_away(const SceneView& scene, const Surface<L>& at, const Material& bsdf,
                              F cos_o) {
        M dark = (!at.front) & (surface_column(scene, at.row, kSurfaceTwoSided) <= F(0.f));
        if (uses(scene, kSmooth)) dark = dark | !(cos_o > F(0.f));
        if (uses(scene, kPass)) dark = dark & !bsdf.only_passes();
        return dark;
    }

    // What a vertex makes of light from wi.
    struct Answer {
        BsdfValue<F> value;
        M lit, behind;  // lanes that the light reaches; those of them where it is from behind
    };
    static VR_HD Answer light_from(V wi, V wo, const Vertex& at, const Material& material,
                                   M active) {
        const F cos_i = dot(at.ns, wi);
        const M ahead = active & (cos_i > F(0.f));
        Answer a{material.eval(wo, wi, cos_i), ahead, no_lanes(active)};
        M either = a.behind;
        if constexpr (has(kSmooth)) {
            if constexpr (Material::kEitherSide) either = active & material.either_side();
            a.lit = (a.lit | either) & (dot(at.ng, wi) > F(0.f));
        }
        if constexpr (Material::kTransmits) {
            a.behind = active & material.transmits() & ((cos_i < F(0.f)) | either) &
                       (a.value.pdf_sa > F(0.f));
            if constexpr (has(kSmooth)) a.behind = a.behind & (dot(at.ng, wi) < F(0.f));
            if constexpr (has(kMedia)) a.behind = a.behind & at.surface;
            a.lit = a.lit | a.behind;
        }
        return a;
    }

    // The other row of a blend, for lanes that have one; `blended` tells these.
    static VR_HD U other_row(const SceneView& scene, const Surface<L>& at, M lanes, M& blended) {
        const U other = as_uint(surface_column(scene, at.row, kSurfaceOther));
        blended = lanes & !(other == U(~0u));
        return select(blended, other, at.row);
    }
    // The chance of a blend's other material, which may be all that is seen from behind.
    static VR_HD F blend_weight(const SceneView& scene, const Surface<L>& at) {
        const F w = number(scene, at, kSurface_blend_weight, kSurface_blend_weight_texture);
        const F sides = surface_column(scene, at.row, kSurfaceTwoSided);
        return select((sides < F(2.f)) | at.front, w, F(1.f));
    }

    // Likewise, in [0, 1]; 0 for lanes without another one.
    static VR_HD F chance(const SceneView& scene, const Surface<L>& at, M blended) {
        return select(blended, max(min(blend_weight(scene, at), F(1.f)), F(0.f)), F(0.f));
    }

    // Of a blend, the one of its materials that a random number chooses; the other one may be a
    // blend, for which what is left of the number counts.
    static VR_HD void choose_material(const SceneView& scene, const PathSettings& s,
                                      const PathState<L>& path, uint32_t segment, M valid,
                                      Surface<L>& at, Choice& choice) {
        choice = {no_lanes(valid), at.row, F(1.f), no_lanes(valid)};
        if (!(scene.features & kBlend)) return;
        M blended;
        U other = other_row(scene, at, valid, blended);
        if (none(blended)) return;
        F u = uniform(
            random_block(s.key, path.pixel, path.sample, dimension_block(segment, kCross)).w);
        while (any(blended)) {
            const F weight = chance(scene, at, blended);
            choice.mixed = choice.mixed | ((weight > F(0.f)) & (weight < F(1.f)));
            const M second = blended & (u < weight);
            choice.share = choice.share * select(second, weight, F(1.f) - weight);
            u = select(second, u / weight, u);
            at.row = select(second, other, at.row);
            other = other_row(scene, at, second, blended);
        }
    }

    // How the surface shows the chosen material.
    static VR_HD void show(const SceneView& scene, const Surface<L>& at, const Material& bsdf,
                           F cos_o, Choice& choice) {
        choice.away = looks_away(scene, at, bsdf, cos_o);
        if constexpr (has(kPass)) choice.share = choice.share * opacity(scene, at);
    }

    // Calls visit(surface, share, lanes) for the materials of blends that were not chosen and whose
    // share is not 0; each lane may be at another one. at: of the chosen one.
    template <class Visit>
    static VR_HD void each_other(const SceneView& scene, Surface<L> at, U first, M lanes,
                                 Visit visit) {
        const U chosen = at.row;
        at.row = first;
        F left(1.f);  // share of this row and those behind
        while (any(lanes)) {
            M blended;
            const U next = other_row(scene, at, lanes, blended);
            const F weight = chance(scene, at, blended), share = left * (F(1.f) - weight);
            M leave = lanes & ((at.row == chosen) | !(share > F(0.f)));
            if (none(leave)) {
                visit(at, share, lanes);
                leave = lanes;
            }
            left = select(leave, left * weight, left);
            at.row = select(leave & blended, next, at.row);
            lanes = lanes & ((blended & (weight > F(0.f))) | !leave);
        }
    }

    // Sums over the materials of blends, for light from two directions.
    static constexpr uint32_t kLight = 0, kNext = 1, kWays = 2;
    struct Sums {
        V wi[kWays];
        M lanes[kWays];
        Answer all[kWays];
    };
    // Adds what the others make of it to what the chosen one, that of `at`, does.
    static VR_LONG Sums with_others(const SceneView& scene, V wo, U primitive, Surface<L> at,
                                    U first, Sums sums) {
        const M lanes = sums.lanes[kLight] | sums.lanes[kNext];
        each_other(scene, at, first, lanes, [&](const Surface<L>& other, F share, M here) {
            const F side = select(at.front, F(1.f), F(-1.f));
            Vertex vertex{};
            vertex.ng = at.ng * side, vertex.ns = at.ns * side, vertex.surface = here;
            Material bsdf = material(scene, other);
            F cos_o;
            look(scene, primitive, other, wo, vertex.ng, here, bsdf, vertex.ns, cos_o);
            here = here & bsdf.scatters() & !looks_away(scene, other, bsdf, cos_o);
            if constexpr (has(kPass)) share = share * opacity(scene, other);
            VR_ROLLED
            for (uint32_t k = 0; k < kWays; ++k) {
                const M wanted = here & sums.lanes[k];
                if (none(wanted)) continue;
                const Answer one = light_from(sums.wi[k], wo, vertex, bsdf, wanted);
                Answer& all = sums.all[k];
                all.value.f_cos =
                    select(one.lit, fma(one.value.f_cos, share, all.value.f_cos), all.value.f_cos);
                all.value.pdf_sa = select(one.lit, fma(one.value.pdf_sa, share, all.value.pdf_sa),
                                          all.value.pdf_sa);
                all.lit = all.lit | one.lit, all.behind = all.behind | one.behind;
            }
        });
        return sums;
    }

    // Of lanes of blends: makes of what the chosen material makes of light from wi what all
    // materials make of it; and weighs directions of non-delta lobes, which the chosen one has
    // drawn, by all. Where their density is beyond all numbers, as of almost smooth ones, the
    // chosen one is all that counts.
    static VR_HD void mix(const SceneView& scene, V wo, const Place& place, V wi, M lanes,
                          Answer& light, BsdfSample<L>& next) {
        const M drawn = place.choice.mixed & place.scatters & (next.pdf_sa > F(0.f));
        if (none(lanes | drawn)) return;
        // On the side that the lobe is for; those on the other one are lost.
        const F cos_i = dot(place.vertex.ns, next.wi), up = dot(place.vertex.ng, next.wi);
        M over = cos_i > F(0.f), under = cos_i < F(0.f);
        if constexpr (Material::kEitherSide) {
            const M either = place.bsdf.either_side();
            over = over | either, under = under | either;
        }
        if constexpr (has(kSmooth)) over = over & (up > F(0.f)), under = under & (up < F(0.f));
        const M sound = drawn & ((under & next.transmitted) | (over & !next.transmitted));

        const F share = place.choice.share;
        const M lit = light.lit & lanes & !place.choice.away, behind = light.behind & lit;
        const M beyond = under & sound;
        const auto part = [&](M m, const S& f_cos, F pdf) -> BsdfValue<F> {
            return {select(m, f_cos * share, S::all(F(0.f))), select(m, pdf * share, F(0.f))};
        };
        const Sums own{{wi, next.wi},
                       {lanes, sound},
                       {{part(lit, light.value.f_cos, light.value.pdf_sa), lit, behind},
                        {part(sound, next.weight * next.pdf_sa, next.pdf_sa), sound, beyond}}};
        const Sums sums =
            with_others(scene, wo, place.hit.primitive, place.at, place.choice.first, own);
        const Answer &all = sums.all[kLight], &ahead = sums.all[kNext];
        const M some = all.lit & (max_channel(all.value.f_cos) > F(0.f));
        light.value.f_cos = select(lanes, all.value.f_cos, light.value.f_cos);
        light.value.pdf_sa = select(lanes, all.value.pdf_sa, light.value.pdf_sa);
        light.lit = some | (light.lit & !lanes);
        light.behind = (all.behind & some) | (light.behind & !lanes);
        const F density = ahead.value.pdf_sa;
        const S weight = S::of([&](uint32_t k) { return ahead.value.f_cos[k] / density; });
        const M known =
            sound & (density < F(kInfinity)) & (max_channel(ahead.value.f_cos) < F(kInfinity));
        next.weight = select(drawn & !sound, S::all(F(0.f)), select(known, weight, next.weight));
        next.pdf_sa = select(known, density, next.pdf_sa);
    }
    // Likewise, without light.
    static VR_HD void weigh(const SceneView& scene, V wo, const Place& place, BsdfSample<L>& next) {
        const M nobody = no_lanes(place.choice.mixed);
        Answer dark{{S::all(F(0.f)), F(0.f)}, nobody, nobody};
        mix(scene, wo, place, next.wi, nobody, dark, next);
    }

    // For the choice of lights, which must not depend on the chosen material: the surface's own
    // normal, and whether any of the materials lets light through.
    static VR_HD void face_all(const SceneView& scene, V wo, const Place& place, V& n, M& both) {
        const M mixed = place.choice.mixed;
        if (none(mixed)) return;
        if constexpr (Material::kTransmits)
            each_other(scene, place.at, place.choice.first, mixed,
                       [&](const Surface<L>& at, F, M here) {
                           Material bsdf;
                           bsdf.kind = to_uint(surface_column(scene, at.row, kSurfaceKind));
                           both = both | (here & bsdf.transmits());
                       });
        const V ns = place.at.ns * select(place.at.front, F(1.f), F(-1.f));
        n = select(mixed, select(dot(ns, wo) > F(0.f), ns, place.vertex.ng), n);
    }
};

}  // namespace veriray
