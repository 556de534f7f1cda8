// What a scheduler is given: samples [sample_begin, sample_begin + samples) of every pixel, or of
// those of a list.
#pragma once

#include "film/shared.h"
#include "integrators/integrator.h"

namespace veriray {

struct SampleRun {
    uint32_t begin, end;
};

struct Job {
    PathSettings settings;
    FilmView film;
    FaultLog* faults;
    uint32_t sample_begin, samples;  // lower 32 bits; a job never crosses a multiple of 2^32
    const uint32_t* listed;          // ascending; null: all pixels
    uint32_t listed_count;
    uint32_t width;        // of the pixels: the film's, or the settings' with a rim
    SharedSamples shared;  // takes the samples, where there is room for them, instead of the film
    Squares squares;
    uint64_t* unit;  // kLater: sums of the unfinished units, [pixel][channel][sum lo, hi]

    VR_HD uint64_t pixels() const {
        return listed ? listed_count : static_cast<uint64_t>(film.width) * film.height;
    }
    VR_HD uint32_t pixel(uint32_t place) const { return listed ? listed[place] : place; }
    VR_HD uint64_t paths() const { return pixels() * samples; }

    // A sample at or above 1 / room of the film's limit is refused.
    VR_HD float room() const { return shared.numbers ? shared.room : 1.f; }
    VR_HD void share(uint32_t at, uint32_t sample, float red, float green, float blue, float x,
                     float y) const {
        const uint32_t rim = shared.reach / 2;
        const uint32_t place = settings.first
                                   ? at - settings.first
                                   : (at / film.width + rim) * shared.width + at % film.width + rim;
        const uint64_t row = shared.row(sample - sample_begin, place);
        const float colour[] = {red, green, blue};
        for (uint32_t c = 0; c < 3; ++c) *shared.number(c, row) = colour[c];
        if (!shared.reach) return;
        *shared.number(3, row) = x;
        *shared.number(3 + shared.reach, row) = y;
    }
    VR_HD uint32_t units() const {
        return static_cast<uint32_t>(unit_count(sample_begin, uint64_t{sample_begin} + samples));
    }
    // The samples of the job's k-th unit, from the job's first on.
    VR_HD SampleRun samples_of_unit(uint32_t k) const {
        const uint32_t cut = sample_begin % kGroupSamples, end = (k + 1) * kGroupSamples - cut;
        return {k ? end - kGroupSamples : 0, end < samples ? end : samples};
    }
    // Adds the sums of a pixel's samples and of their squares to the film.
    VR_HD void add(uint32_t at, PixelSum& sum) const {
        if (!shared.numbers) flush(film, at, sum);
    }
    // Adds the sum of n samples of a pixel: those of a unit, or of a part of one.
    VR_HD void add_unit(uint32_t at, PixelSum& sum, uint32_t n) const {
        if (squares == Squares::kLater) return add_to_unit(unit, at, sum);
        end_unit(sum, n);
        flush(film, at, sum);
    }
    // A pixel's unit of n samples is complete.
    VR_HD void end_unit_of(uint32_t at, uint32_t n) const {
        PixelSum sum = take_unit(unit, at);
        end_unit(sum, n);
        flush(film, at, sum);
    }
};

// How `thrust` closes the gaps that ended paths leave in the index array before the next bounce:
// not at all, by remove_if, partition, copy_if into another array, or by appending to one during
// the bounce.
enum class Compaction : uint32_t { kNone, kRemoveIf, kPartition, kCopy, kAppend };
enum class Method : uint32_t { kFused, kThrust, kWavefront };
struct SchedulerInfo {
    const char* name;
    Method method;
    Compaction compaction = Compaction::kNone;  // kThrust
    bool sorted = false;                        // kWavefront: by material
};
inline constexpr SchedulerInfo kSchedulers[] = {
    {"fused", Method::kFused},
    {"thrust", Method::kThrust, Compaction::kRemoveIf},
    {"thrust-none", Method::kThrust, Compaction::kNone},
    {"thrust-partition", Method::kThrust, Compaction::kPartition},
    {"thrust-copy", Method::kThrust, Compaction::kCopy},
    {"thrust-append", Method::kThrust, Compaction::kAppend},
    {"wavefront", Method::kWavefront, Compaction::kNone, true},
    {"wavefront-unsorted", Method::kWavefront},
};

// Why a path ended at this bounce; kLive if it goes on.
VR_HD LedgerColumn cause_of(const Events<Scalar>& e) {
    if (e.escaped) return kEscaped;
    if (e.emitter_end) return kEmitterEnd;
    if (e.absorbed) return kAbsorbed;
    if (e.depth_cut) return kDepthCut;
    return e.rr_killed ? kRrKilled : kLive;
}

// finish: the sample that a scalar path has for the film; none if the film refuses it, which is
// logged. Returns the path's cause.
template <class Tracer>
VR_HD LedgerColumn finish(const SceneView& scene, const Job& job,
                          const typename Tracer::State& path, LedgerColumn cause,
                          Spectrum<float>& sample) {
    sample = Spectrum<float>::all(0.f);
    if (film_accepts<Tracer::kNegativeSamples>(path.radiance, job.film.scale * job.room())) {
        sample = path.radiance * job.film.scale;
    } else {
        log_fault(job.faults, path.pixel, path.sample, path.radiance);
        cause = kInvalid;
    }
    if (job.shared.numbers) {
        float x = 0.f, y = 0.f;
        if (job.shared.reach) Tracer::place_in_pixel(job.settings, path.pixel, path.sample, x, y);
        job.share(path.pixel, path.sample, sample[0], sample[1], sample[2], x, y);
        sample = Spectrum<float>::all(0.f);
    }
    return cause;
}

}  // namespace veriray
