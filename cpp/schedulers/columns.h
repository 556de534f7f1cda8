// Paths as columns in memory, for schedulers that keep them there between launches.
#pragma once

#include "schedulers/job.h"

namespace veriray {

struct Columns {
    float* floats;    // [column][capacity]
    uint32_t* uints;  // likewise
    uint32_t capacity;

    VR_HD float& f(uint64_t column, uint32_t i) const { return floats[column * capacity + i]; }
    VR_HD uint32_t& u(uint64_t column, uint32_t i) const { return uints[column * capacity + i]; }
};

template <uint32_t kFeatures>
VR_HD PathState<Scalar> load_path(const Columns& c, uint32_t i) {
    PathState<Scalar> p{};
    each_field<kFeatures>(
        p, [&](uint64_t k, float& x) { x = c.f(k, i); },
        [&](uint64_t k, uint32_t& x) { x = c.u(k, i); });
    return p;
}

// A path that has only moved on stores no pixel and sample.
template <uint32_t kFeatures>
VR_HD void store_path(const Columns& c, uint32_t i, PathState<Scalar> p, bool moved = false) {
    each_field<kFeatures>(
        p, [&](uint64_t k, float x) { c.f(k, i) = x; },
        [&](uint64_t k, uint32_t x) {
            if (k > kSampleField || !moved) c.u(k, i) = x;
        });
}

// Path g of the job: sample by sample, in each all pixels. A job has 2^31 paths at most.
template <uint32_t kFeatures>
VR_HD PathState<Scalar> begin_path(const SceneView& scene, const Job& job, uint32_t g) {
    const uint32_t pixels = static_cast<uint32_t>(job.pixels()), sample = g / pixels;
    const uint32_t pixel = job.pixel(g - sample * pixels), width = job.film.width;
    return PathTracer<Scalar, kFeatures>::begin(scene, job.settings, pixel % width, pixel / width,
                                                width, job.sample_begin + sample);
}

// Ends a path: its sample goes to the film. Returns the path's cause.
template <uint32_t kFeatures>
VR_HD LedgerColumn end_path(const SceneView& scene, const Job& job, const PathState<Scalar>& path,
                            LedgerColumn cause) {
    Spectrum<float> sample;
    PixelSum sum{};
    cause = finish<kFeatures>(scene, job, path, cause, sample);
    add_sample(sum, sample);
    if (cause != kInvalid) flush(job.film, path.pixel, sum);
    return cause;
}

}  // namespace veriray
