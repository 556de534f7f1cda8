// Feature images: what is known of the first surface that a camera ray meets, as stages.
//
// The rays begin as those of the path tracer, with the same random numbers and lens, but are always
// drawn from the filter: pixels share no samples here. They go on through null surfaces, uncovered
// parts of masks and lamps that are hidden from the camera, with the path's own random numbers, and
// through media. A mirror or glass is itself, not what it shows.
#pragma once

#include "film/features.h"
#include "integrators/path.h"
#include "scene/variants.h"

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
    using Along = Tangents<L>;
    using typename Tracer::State, typename Reader::Material;

    struct Found {
        M met;
        U primitive;
        V p, ng, ns;
        S albedo;
        F u, v;

        VR_HD void take(const Found& other) {
            const M lanes = other.met;
            met = met | lanes;
            primitive = select(lanes, other.primitive, primitive);
            p = select(lanes, other.p, p);
            ng = select(lanes, other.ng, ng);
            ns = select(lanes, other.ns, ns);
            albedo = select(lanes, other.albedo, albedo);
            u = select(lanes, other.u, u);
            v = select(lanes, other.v, v);
        }
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

    // ---- find: the first surface ahead that the ray does not pass; colours: its albedo too ----
    static VR_HD Found find(const SceneView& scene, const PathSettings& s, State& path, M active,
                            bool colours) {
        Found found{};
        found.met = no_lanes(active);
        for (uint32_t segment = 0; segment < kHardMaxDepth; ++segment) {
            Hit<L> hit;
            Surface<L> at;
            const M valid = meet(scene, path, segment, active, hit, at);
            if (none(valid)) break;
            Material bsdf;
            if constexpr (has(kBlend)) {
                typename Tracer::Choice choice;
                Vertices::choose_material(scene, s, path, segment, valid, at, choice);
            }
            if (colours)
                bsdf = Reader::material(scene, at);
            else if constexpr (!Material::kOneKind)
                bsdf.kind = to_uint(Reader::surface_column(scene, at.row, kSurfaceKind));
            const M passed = passes(scene, s, path, segment, hit, at, bsdf, valid);
            const Found now = seen(scene, path.ray, hit, at, valid & !passed, colours, bsdf);
            if (segment)
                found.take(now);
            else
                found = now;
            if (none(passed)) break;
            path.travelled = select(passed, hit.t, path.travelled);
            path.passed = select(passed, hit.primitive, path.passed);
            active = passed;
        }
        return found;
    }

    // ---- look: calls put(kind, numbers, met) for the features that are wanted; returns the lanes
    // that met something ----
    template <class Put>
    static VR_HD M look(const SceneView& scene, const PathSettings& s, const FeatureView& view,
                        State& path, M active, Put put) {
        const auto wanted = [&](FeatureKind k) { return (view.wanted >> k & 1u) != 0; };
        const Found f = find(scene, s, path, active, wanted(kAlbedoFeature));
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
        const Found found = find(scene, s, path, active, false);
        return select(found.met, found.primitive + U(1u), U(0u));
    }

   private:
    static VR_HD F affine(const float* row, const V& p) {
        return fma(F(row[2]), p.z, fma(F(row[1]), p.y, fma(F(row[0]), p.x, F(row[3]))));
    }

    // The surface ahead; returns the lanes that have one.
    static VR_HD M meet(const SceneView& scene, const State& path, uint32_t segment, M active,
                        Hit<L>& hit, Surface<L>& at) {
        hit = Reader::next_hit(scene, path, F(kInfinity), active);
        if constexpr (has(kMedia)) hit = Rim::past_rims(scene, path.ray, hit, active);
        const F far = Vertices::far_end(scene, path, segment);
        M valid = active & (hit.t < F(kInfinity));
        if constexpr (has(kClip)) {
            valid = valid & (hit.t <= far);
            hit.t = select(valid, hit.t, F(kInfinity));
        }
        at = Reader::surface_at(scene, path.ray, hit, valid);
        if constexpr (!has(kMedia))
            valid = valid & !Rim::leave_rims(scene, path.ray, far, hit, at, valid);
        return valid;
    }

    // Those of the lanes that go on behind the surface, as in `surface_vertex`; through null ones
    // for certain.
    static VR_HD M passes(const SceneView& scene, const PathSettings& s, const State& path,
                          uint32_t segment, const Hit<L>& hit, const Surface<L>& at,
                          const Material& bsdf, M valid) {
        M passed = no_lanes(valid);
        if constexpr (has(kHidden)) passed = Vertices::hidden_lamp(scene, path, hit, valid);
        if constexpr (has(kPass)) {
            if (!(scene.features & kPass)) return passed;
            passed = passed | (valid & bsdf.only_passes());
            const F opacity = Vertices::opacity(scene, at);
            const M thin = valid & !passed & (opacity < F(1.f));
            if (none(thin)) return passed;
            const U u =
                random_block(s.key, path.pixel, path.sample, dimension_block(segment, kCross)).z;
            passed = passed | (thin & !(uniform(u) < opacity));
        }
        return passed;
    }

    // What is known of the surface there, as seen along the ray.
    static VR_HD Found seen(const SceneView& scene, const Ray<L>& ray, const Hit<L>& hit,
                            const Surface<L>& at, M lanes, bool colours, Material& bsdf) {
        const V wo = -ray.d;
        const F side = select(at.front, F(1.f), F(-1.f));
        V ns = at.ns * side;
        [[maybe_unused]] typename Along::Partials along;
        if constexpr (has(kTangents))
            if (scene.tangents) {
                along = Along::template partials<Reader>(scene, hit.primitive, at, lanes);
                Along::template relieve<Reader>(scene, along, at, wo, lanes, bsdf, ns);
            }
        F cos_o = dot(ns, wo);
        if constexpr (has(kSmooth)) Reader::face_viewer(bsdf, wo, at.ng * side, ns, cos_o);
        Found now{lanes, hit.primitive, at.p, at.ng, ns * side, S::all(F(0.f)), F(0.f), F(0.f)};
        if constexpr (has(kTextures | kTangents)) now.u = at.uv.u, now.v = at.uv.v;
        if (!colours) return now;
        bsdf.set_view(ns, cos_o, at.front);
        if constexpr (has(kTangents))
            if (scene.tangents) {
                bsdf.view.tangents = true;
                bsdf.view.tangent = Along::across(Along::across(along.u, at.ns), ns);
            }
        const M dark = Vertices::is_dark(scene, at, bsdf, cos_o);
        now.albedo = select(dark, now.albedo, bsdf.albedo());
        return now;
    }
};

// Features of scenes that matter here: not those of lights, of media and of what lies behind.
inline constexpr FeatureMask kSeenFirst = kQuads | kPolygons | kDisks | kSpheres | kBvh | kSmooth |
                                          kClip | kLens | kPass | kTextures | kBlend | kAttributes |
                                          kTangents | kHidden | materials(kAllKinds);
// The compiled sets of features, smallest first; the last holds everything.
inline constexpr FeatureMask kFeatureVariants[] = {
    kQuads | kPolygons | kClip | kPlainMaterials,
    kDiffuseFlat | kDiffuseMesh | kDisks | kSpheres | kLens,
    kAllFeatures,
};
inline constexpr uint32_t kFeatureVariantCount =
    sizeof(kFeatureVariants) / sizeof(kFeatureVariants[0]);

// What back ends take feature images by. It has no bounces, and samples of more numbers than
// schedulers carry, so it is no Integrator.
template <class L, uint32_t kVariant>
using FeatureImages = FirstSurface<L, kFeatureVariants[kVariant]>;

// Calls fn.template operator()<variant>() with the smallest that covers a scene's features.
template <uint32_t kVariant = 0, class Fn>
auto with_feature_variant(FeatureMask features, bool all, Fn&& fn) {
    if constexpr (kVariant + 1 < kFeatureVariantCount)
        if (all || (features & kSeenFirst & ~kFeatureVariants[kVariant]))
            return with_feature_variant<kVariant + 1>(features, all, fn);
    return fn.template operator()<kVariant>();
}

}  // namespace veriray
