// Feature images: what is known of the first surface that a camera ray meets, as stages.
//
// The rays are those of the path tracer: the same random numbers, filter and lens. They go on
// through null surfaces, uncovered parts of masks and lamps that are hidden from the camera, with
// the path's own random numbers, and through media. A mirror or glass is itself, not what it shows.
#pragma once

#include "film/features.h"
#include "integrators/path.h"

namespace veriray {

template <class L, FeatureMask kFeatures>
struct FirstSurface : PathTracer<L, kFeatures> {
    using Tracer = PathTracer<L, kFeatures>;
    using Reader = SurfaceReader<L, kFeatures>;
    using Vertices = PathVertices<L, kFeatures>;
    using Rim = Rims<L, kFeatures>;
    using Reader::has;
    using Tracer::no_lanes;
    using typename Reader::F, typename Reader::U, typename Reader::M, typename Reader::V,
        typename Reader::S;
    using typename Tracer::State, typename Vertices::Place;

    struct Found {
        M met;
        U primitive;
        V p, ng, ns;
        S albedo;
        F u, v;
    };

    // ---- begin: as a camera path, or through the pixel's centre and the lens's ----
    static VR_HD State begin(const SceneView& scene, const PathSettings& s, U x, U y,
                             uint32_t width, U sample, bool centre) {
        State path = Tracer::begin(scene, s, x, y, width, sample);
        path.medium = U(0u);
        if (!centre) return path;
        const F half(0.5f);
        path.ray = pinhole_ray<L>(scene.camera,
                                  camera_point(scene.camera, to_float(x), to_float(y), half, half));
        if (scene.camera.before > 0.f)
            path.ray = far_ray<L>(scene.camera, to_float(x), to_float(y), half, half);
        if constexpr (has(kClip)) {
            const F cosine = dot(path.ray.d, broadcast<F>(scene.camera.forward));
            path.ray.o = fma(path.ray.d, F(scene.camera.near_clip) / cosine, path.ray.o);
        }
        return path;
    }

    // ---- find: the first surface ahead that the ray does not pass ----
    static VR_HD Found find(const SceneView& scene, const PathSettings& s, State& path, M active) {
        const F zero(0.f);
        const V nowhere{zero, zero, zero};
        Found found{no_lanes(active), U(0u), nowhere, nowhere, nowhere, S::all(zero), zero, zero};
        for (uint32_t segment = 0; segment < kHardMaxDepth; ++segment) {
            Place place;
            const M valid = meet(scene, path, segment, active, place);
            if (none(valid)) break;
            Events<L> ends;
            Vertices::surface_vertex(scene, s, path, segment, valid, place, ends);
            const M passed = valid & (place.pass | place.bsdf.only_passes());
            take(place, ends, path.ray, valid & !passed, segment == 0, found);
            if (none(passed)) break;
            path.travelled = select(passed, place.hit.t, path.travelled);
            path.passed = select(passed, place.hit.primitive, path.passed);
            active = passed;
        }
        return found;
    }

    // ---- look: calls put(kind, numbers, met) for the features that are wanted; returns the lanes
    // that met something ----
    template <class Put>
    static VR_HD M look(const SceneView& scene, const PathSettings& s, const FeatureView& view,
                        State& path, M active, Put put) {
        const Found f = find(scene, s, path, active);
        const auto wanted = [&](FeatureKind k) { return (view.wanted >> k & 1u) != 0; };
        const auto put_vector = [&](FeatureKind k, const V& v) {
            const F numbers[3] = {v.x, v.y, v.z};
            if (wanted(k)) put(k, numbers, f.met);
        };
        const F z = affine(view.axis, f.p);
        if (wanted(kDepthFeature)) {
            const F cosine = dot(path.ray.d, broadcast<F>(scene.camera.forward));
            const F along[3] = {z / cosine};
            put(kDepthFeature, along, f.met);
        }
        if (wanted(kDepthAxisFeature)) {
            const F along[3] = {z};
            put(kDepthAxisFeature, along, f.met);
        }
        put_vector(kPositionFeature, f.p);
        put_vector(kNormalFeature, f.ns);
        put_vector(kGeoNormalFeature, f.ng);
        if (wanted(kAlbedoFeature)) {
            const F numbers[3] = {f.albedo[0], f.albedo[1], f.albedo[2]};
            put(kAlbedoFeature, numbers, f.met);
        }
        if (wanted(kUvFeature)) {
            const F numbers[3] = {f.u, f.v};
            put(kUvFeature, numbers, f.met);
        }
        if (wanted(kMotionFeature)) {
            const auto& a = view.motion[0];
            const auto& b = view.motion[1];
            const F from = affine(a[2], f.p), to = affine(b[2], f.p);
            const M seen = f.met & (from > F(0.f)) & (to > F(0.f));
            const auto moved = [&](int k) {
                return select(seen, affine(b[k], f.p) / to - affine(a[k], f.p) / from, F(0.f));
            };
            const F numbers[3] = {moved(0), moved(1)};
            put(kMotionFeature, numbers, f.met);
        }
        return f.met;
    }

    // The number of a plane kPrimitivePlane.
    static VR_HD U primitive_at_centre(const SceneView& scene, const PathSettings& s, U x, U y,
                                       uint32_t width, M active) {
        State path = begin(scene, s, x, y, width, U(0u), true);
        const Found found = find(scene, s, path, active);
        return select(found.met, found.primitive + U(1u), U(0u));
    }

   private:
    static VR_HD F affine(const float* row, const V& p) {
        return fma(F(row[2]), p.z, fma(F(row[1]), p.y, fma(F(row[0]), p.x, F(row[3]))));
    }

    // The surface ahead; returns the lanes that have one.
    static VR_HD M meet(const SceneView& scene, const State& path, uint32_t segment, M active,
                        Place& place) {
        Hit<L>& hit = place.hit;
        hit = Reader::next_hit(scene, path, F(kInfinity), active);
        if constexpr (has(kMedia)) hit = Rim::past_rims(scene, path.ray, hit, active);
        const F far = Vertices::far_end(scene, path, segment);
        M valid = active & (hit.t < F(kInfinity));
        if constexpr (has(kClip)) {
            valid = valid & (hit.t <= far);
            hit.t = select(valid, hit.t, F(kInfinity));
        }
        place.collided = no_lanes(active);
        place.vertex.p = path.ray.o;
        place.at = Reader::surface_at(scene, path.ray, hit, valid);
        if constexpr (!has(kMedia))
            valid = valid & !Rim::leave_rims(scene, path.ray, far, hit, place.at, valid);
        return valid;
    }

    // Keeps what is at the surfaces of some lanes; all: nothing has been kept yet.
    static VR_HD void take(const Place& place, const Events<L>& ends, const Ray<L>& ray, M lanes,
                           bool all, Found& found) {
        const Surface<L>& at = place.at;
        const F side = select(at.front, F(1.f), F(-1.f));
        Found now{lanes,
                  place.hit.primitive,
                  at.p,
                  at.ng,
                  place.vertex.ns * side,
                  place.bsdf.albedo(),
                  F(0.f),
                  F(0.f)};
        if constexpr (has(kTextures | kTangents)) now.u = at.uv.u, now.v = at.uv.v;
        const M dark = ends.emitter_end | ends.absorbed;
        now.albedo = select(dark, S::all(F(0.f)), now.albedo);
        if (all) {
            found = now;
            return;
        }
        found.met = found.met | lanes;
        found.primitive = select(lanes, now.primitive, found.primitive);
        found.p = select(lanes, now.p, found.p);
        found.ng = select(lanes, now.ng, found.ng);
        found.ns = select(lanes, now.ns, found.ns);
        found.albedo = select(lanes, now.albedo, found.albedo);
        found.u = select(lanes, now.u, found.u);
        found.v = select(lanes, now.v, found.v);
    }
};

// What back ends take feature images by, compiled once for all features of scenes. It has no
// bounces, and samples of more numbers than schedulers carry, so it is no Integrator.
template <class L>
using FeatureImages = FirstSurface<L, kAllFeatures>;

}  // namespace veriray
