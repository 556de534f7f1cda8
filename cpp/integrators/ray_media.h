// The media that rays are in: which one is beyond a surface, and what they let through.
#pragma once

#include "integrators/blend.h"
#include "integrators/volumes.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct RayMedia : Blends<L, kFeatures> {
    using Reader = SurfaceReader<L, kFeatures>;
    using Blend = Blends<L, kFeatures>;
    using Blend::no_lanes;
    using Reader::has, Reader::passed, Reader::surface_column;
    using typename Blend::PhaseFunction;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V,
        typename Reader::S;

    static VR_HD F medium_column(const SceneView& scene, U medium, uint32_t c) {
        return gather(scene.media + c * scene.medium_stride, medium);
    }
    static VR_HD S medium_spectrum(const SceneView& scene, U medium, uint32_t c) {
        return S::of([&](uint32_t k) { return medium_column(scene, medium, c + k); });
    }

    static VR_HD PhaseFunction phase_function(const SceneView& scene, U medium) {
        const U none(0u);
        const F g = medium_column(scene, medium, kMediumG);
        if (!has(kPhases) || !scene.phases.most) return {g, none, none, none};
        return {g, medium, to_uint(medium_column(scene, medium, kMediumLobe)),
                to_uint(medium_column(scene, medium, kMediumLobes))};
    }

    // The share of a medium's extinction that rays along d meet.
    static VR_HD F met_along(const SceneView& scene, U medium, V d) {
        const F lobe = medium_column(scene, medium, kMediumFlakes);
        const M facets = lobe >= F(0.f);
        if (none(facets)) return F(1.f);
        const U row = to_uint(select(facets, lobe, F(0.f)));
        return select(facets, PhaseFunction::flakes(scene.phases, row).area(d), F(1.f));
    }
    static VR_HD bool has_flakes(const SceneView& scene) {
        return has(kPhases) && scene.phases.flakes;
    }
    static VR_HD S extinction(const SceneView& scene, U medium, V d) {
        const S sigma = medium_spectrum(scene, medium, kMediumSigma);
        return has_flakes(scene) ? sigma * met_along(scene, medium, d) : sigma;
    }

    static constexpr float kSwappedWithin = 0x1p-14f, kParallelFaces = 0.999f;

    // The medium on the other side, for lanes that go `through`. Carrier: path or shadow request.
    template <class Carrier>
    static VR_HD U medium_beyond(const SceneView& scene, const Carrier& c, const Hit<L>& hit,
                                 const Surface<L>& at, M through) {
        const F inside = surface_column(scene, at.row, kSurfaceInside);
        const F outside = surface_column(scene, at.row, kSurfaceOutside);
        M border = through & (inside >= F(0.f));
        if constexpr (has(kPass)) border = border & !swapped(scene, c, hit, at, border);
        const F beyond = max(select(at.front, inside, outside), F(0.f));
        return select(border, to_uint(beyond), c.medium);
    }

    // Borders that lie before the parallel one that the ray has just passed: from far away,
    // rounding may swap them. The medium there is that beyond the other one. Only hits that close
    // are looked at, and faces that enclose less than 2 degrees: others cannot be swapped.
    template <class Carrier>
    static VR_HD M swapped(const SceneView& scene, const Carrier& c, const Hit<L>& hit,
                           const Surface<L>& at, M border) {
        M close =
            border & (c.travelled > F(0.f)) & (hit.t - c.travelled <= hit.t * F(kSwappedWithin));
        if constexpr (has(kSpheres))
            close = close & (c.passed < U(scene.first_sphere)) &
                    (hit.primitive < U(scene.first_sphere));
        if (none(close)) return close;
        const U passed = select(close, c.passed, U(0u)), row = Reader::surface_row(scene, passed);
        const V n = Reader::primitive_column3(scene, passed, kPrimN);
        const F over = dot(n, at.p) - Reader::primitive_column(scene, passed, kPrimPlane);
        const F turn = dot(n, at.ng);
        return close & (over * dot(n, c.ray.d) < F(0.f)) & (turn * turn > F(kParallelFaces)) &
               (surface_column(scene, row, kSurfaceInside) >= F(0.f));
    }

    // Rays in a medium that meet nothing have left it, at an edge within rounding, if its boundary
    // is closed.
    template <class Carrier>
    static VR_HD void leave_closed(const SceneView& scene, Carrier& c, M endless) {
        if (none(endless)) return;
        const U beyond = to_uint(medium_column(scene, c.medium, kMediumBeyond));
        c.medium = select(endless, beyond, c.medium);
    }

    // Lanes in a medium whose extinction a grid gives.
    static VR_HD M uneven_medium(const SceneView& scene, U medium) {
        return medium_column(scene, medium, kMediumSigmaGrid) >= F(0.f);
    }
    // Their way through it, `limit` long, from where a ray has passed all.
    template <class Carrier>
    static VR_HD auto passage(const SceneView& scene, const Carrier& c, F limit, M uneven) {
        const F row = medium_column(scene, c.medium, kMediumSigmaGrid);
        return Volumes<L>::passage(scene, to_uint(select(uneven, row, F(0.f))),
                                   c.ray.at(passed(c).t), c.ray.d, limit);
    }

    // Replaces the transmittance of lanes in uneven media.
    static VR_HD void thin_out(const SceneView& scene, ShadowRequest<L>& shadow, F distance,
                               M inside, S& t) {
        const M uneven =
            inside & uneven_medium(scene, shadow.medium) & (max_channel(shadow.radiance) > F(0.f));
        if (none(uneven)) return;
        const auto way = passage(scene, shadow, distance, uneven);
        F sigma = medium_column(scene, shadow.medium, kMediumSigma);
        if (has_flakes(scene)) sigma = sigma * met_along(scene, shadow.medium, shadow.ray.d);
        RandomStream<U> random = shadow.random;
        t = select(uneven, Volumes<L>::transmittance(scene, way, sigma, random, uneven), t);
        shadow.random = random;
    }

    static VR_HD void attenuate(const SceneView& scene, ShadowRequest<L>& shadow, F distance,
                                M active) {
        M inside = active & !(shadow.medium == U(0u));
        leave_closed(scene, shadow, inside & !(distance < F(kInfinity)));
        inside = inside & !(shadow.medium == U(0u));
        if (none(inside)) return;
        S t = transmittance(extinction(scene, shadow.medium, shadow.ray.d), distance);
        if constexpr (has(kUnevenMedia))
            if (scene.features & kUnevenMedia) thin_out(scene, shadow, distance, inside, t);
        shadow.radiance = select(inside, shadow.radiance * t, shadow.radiance);
    }
};

}  // namespace veriray
