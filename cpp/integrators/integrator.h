// What an integrator is to schedulers and back ends, which name none. It is a template on lane type
// and features; its stages know no loop, queue or launch. integrators.h lists the integrators.
#pragma once

#include <concepts>

#include "integrators/path_state.h"

namespace veriray {

// State: what a path carries, with `pixel`, `sample` and `radiance`. Request: a shadow ray, with
// `wanted`. each_field<use>, each_request_field: their columns in memory (path_state.h).
template <class T>
concept Integrator =
    requires(const SceneView& scene, const PathSettings& s, typename T::U word,
             typename T::M active, typename T::State path, typename T::Request request,
             Hit<typename T::Lane> hit, typename T::F at) {
        { T::kMask } -> std::convertible_to<FeatureMask>;
        // Samples below 0 are legitimate; else the film refuses them.
        { T::kNegativeSamples } -> std::convertible_to<bool>;
        { T::begin(scene, s, word, word, 0u, word) } -> std::same_as<typename T::State>;
        { T::no_request(active) } -> std::same_as<typename T::Request>;
        // The closest surface ahead.
        { T::next_hit(scene, path, kInfinity, active) } -> std::same_as<Hit<typename T::Lane>>;
        // From there to the next ray; a shadow ray may be requested, or is known to be occluded.
        {
            T::scatter(scene, s, path, hit, 0u, active, request)
        } -> std::same_as<Events<typename T::Lane>>;
        // Lanes whose shadow ray arrives, and what it delivers.
        { T::unblocked(scene, request) } -> std::same_as<typename T::M>;
        { T::visible(path, request, active) };
        // Where a sample's path goes through its pixel, x and y in [0, 1), if these share samples.
        { T::place_in_pixel(s, word, word, at, at) };
        { T::columns(0u) } -> std::same_as<ColumnCount>;
        { T::request_columns(0u) } -> std::same_as<ColumnCount>;
    };

// One bounce: from the ray of segment `segment` to the next one.
template <Integrator T>
VR_HD Events<typename T::Lane> bounce(const SceneView& scene, const PathSettings& s,
                                      typename T::State& path, uint32_t segment,
                                      typename T::M active) {
    typename T::Request shadow = T::no_request(active);
    const auto hit = T::next_hit(scene, path, typename T::F(kInfinity), active);
    auto e = T::scatter(scene, s, path, hit, segment, active, shadow);
    if (any(shadow.wanted)) {
        e.visible = T::unblocked(scene, shadow);
        e.occluded = e.occluded | (shadow.wanted & !e.visible);
        T::visible(path, shadow, e.visible);
    }
    return e;
}

// T with stages that are called, not inlined: for schedulers to share where they are not the
// fastest.
template <Integrator T>
struct Called : T {
    using F = typename T::F;
    using M = typename T::M;

    VR_CALLED static Hit<typename T::Lane> next_hit(const SceneView& scene,
                                                    const typename T::State& path, F t_max,
                                                    M active) {
        return T::next_hit(scene, path, t_max, active);
    }
    VR_CALLED static Events<typename T::Lane> scatter(const SceneView& scene, const PathSettings& s,
                                                      typename T::State& path,
                                                      const Hit<typename T::Lane>& hit,
                                                      uint32_t segment, M active,
                                                      typename T::Request& shadow) {
        return T::scatter(scene, s, path, hit, segment, active, shadow);
    }
    VR_CALLED static M unblocked(const SceneView& scene, typename T::Request& shadow) {
        return T::unblocked(scene, shadow);
    }
};

}  // namespace veriray
