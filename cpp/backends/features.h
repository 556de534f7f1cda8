// Feature images, on either machine: what is done, and what each back end does of it.
#pragma once

#include <vector>

#include "api/renderer.h"
#include "film/features.h"

namespace veriray {

// Samples [sample_begin, sample_begin + samples) of every pixel of the film, which has some of the
// scene's rows. Pixels count from its first one.
struct FeatureJob {
    PathSettings settings;
    FeatureView view;
    PlaneView planes[kFeatureKinds];  // those that are wanted
    uint32_t first[kFeatureKinds];    // of these, the first of their channels
    uint32_t channels;                // of all
    PlaneView hits, primitive;        // without words: not wanted
    FaultLog* faults;
    uint32_t width, pixels, first_row;
    uint32_t sample_begin, samples;
    bool centres;  // sample 0 is among them
};

// Whether a plane takes a sample; log_refused notes one that it does not.
template <class F>
VR_HD auto feature_accepted(const PlaneView& plane, const F* x) {
    const F limit(kSampleLimit), scale(plane.scale);
    auto good = abs(x[0] * scale) < limit;
    for (uint32_t c = 1; c < plane.channels; ++c) good = good & (abs(x[c] * scale) < limit);
    return good;
}
VR_HD void log_refused(const FeatureJob& job, FeatureKind kind, uint32_t pixel, uint32_t sample,
                       const float* x) {
    const uint32_t last = job.planes[kind].channels - 1;
    log_fault(job.faults, job.first_row * job.width + pixel, sample,
              {{x[0], x[last < 1 ? last : 1], x[last < 2 ? last : 2]}});
}

// The features that a scene's feature images need: texture coordinates may be asked for without any
// textures.
inline FeatureMask needed(const SceneView& view) {
    return view.features | (view.uv ? FeatureMask{kTextures} : 0u);
}

// Runs a job whose fault log lies in the host's memory. maps: HostScene::texture_maps, for a scene
// whose view has none; else empty. Returns false if poll stopped it.
bool run_features(const Scene& scene, const FeatureJob& job, const std::vector<float>& maps,
                  const RenderSettings& s, RenderStats& stats, const Poll& poll);

}  // namespace veriray
