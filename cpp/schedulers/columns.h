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

// Fields of these uses; the others stay as they are.
template <class Tracer, uint32_t kUse = kWholePath>
VR_HD void load_fields(const Columns& c, uint32_t i, typename Tracer::State& p) {
    Tracer::template each_field<kUse>(
        p, [&](uint64_t k, float& x) { x = c.f(k, i); },
        [&](uint64_t k, uint32_t& x) { x = c.u(k, i); });
}
template <class Tracer, uint32_t kUse = kWholePath>
VR_HD typename Tracer::State load_path(const Columns& c, uint32_t i) {
    typename Tracer::State p{};
    load_fields<Tracer, kUse>(c, i, p);
    return p;
}
template <class Tracer, uint32_t kUse = kWholePath>
VR_HD void store_path(const Columns& c, uint32_t i, const typename Tracer::State& p) {
    Tracer::template each_field<kUse>(
        p, [&](uint64_t k, float x) { c.f(k, i) = x; },
        [&](uint64_t k, uint32_t x) { c.u(k, i) = x; });
}

// Path g of the job: sample by sample, in each all pixels. A job has 2^31 paths at most.
template <class Tracer>
VR_HD typename Tracer::State begin_path(const SceneView& scene, const Job& job, uint32_t g) {
    const uint32_t pixels = static_cast<uint32_t>(job.pixels()), sample = g / pixels;
    const uint32_t pixel = job.pixel(g - sample * pixels), width = job.width;
    return Tracer::begin(scene, job.settings, pixel % width, pixel / width, width,
                         job.sample_begin + sample);
}

// Ends a path: its sample goes to the film. Returns the path's cause.
template <class Tracer>
VR_HD LedgerColumn end_path(const SceneView& scene, const Job& job,
                            const typename Tracer::State& path, LedgerColumn cause) {
    Spectrum<float> sample;
    PixelSum sum{};
    cause = finish<Tracer>(scene, job, path, cause, sample);
    add_sample(sum, sample);
    if (cause != kInvalid) job.add(path.pixel, sum);
    return cause;
}

}  // namespace veriray
