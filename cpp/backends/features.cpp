// Feature images: checks, and the order of their work.
#include "backends/features.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "backends/film_memory.h"
#include "backends/instances.h"
#include "backends/render.h"

namespace veriray {
namespace {

// The planes of the film that are wanted; returns a job without samples.
FeatureJob job_of(Film& film) {
    FeatureJob job{};
    job.width = film.width(), job.pixels = film.width() * film.height();
    for (size_t i = 1; i < film.planes().size(); ++i) {
        const PlaneInfo& p = film.planes()[i];
        const bool hits = p.name == kHitsPlane, primitive = p.name == kPrimitivePlane;
        if (hits || primitive) {
            if (p != PlaneInfo{p.name, PlaneKind::kIntegers, 1, false})
                fail("plane '" + p.name + "' must hold integers of 1 channel");
            (hits ? job.hits : job.primitive) = film.impl->plane(p.name, 0);
            continue;
        }
        uint32_t k = 0;
        while (k < kFeatureKinds && p.name != kFeatureInfos[k].name) ++k;
        if (k == kFeatureKinds) {
            std::string names = std::string(kHitsPlane) + ", " + kPrimitivePlane;
            for (const FeatureInfo& info : kFeatureInfos) names += std::string(", ") + info.name;
            fail("plane '" + p.name + "' is no feature image; allowed: " + names);
        }
        const FeatureInfo& info = kFeatureInfos[k];
        if (p != PlaneInfo{info.name, PlaneKind::kSumsAndSquares, info.channels, true})
            fail("plane '" + p.name + "' must hold sums and squares of " +
                 std::to_string(info.channels) + " channels, negative ones too");
        job.view.wanted |= 1u << k;
        job.planes[k] = film.impl->plane(p.name, info.scale);
        job.first[k] = job.channels;
        job.channels += info.channels;
    }
    if (!job.hits.words) fail(std::string("the film has no plane '") + kHitsPlane + "'");
    return job;
}

// Rows of numbers of world points as rows of normalised ones, up to a factor of all.
void put_row(const Frame& frame, const double* row, double scale, float* out) {
    const double at_origin =
        row[0] * frame.centre.x + row[1] * frame.centre.y + row[2] * frame.centre.z + row[3];
    for (int k = 0; k < 3; ++k) out[k] = static_cast<float>(row[k] * scale);
    out[3] = static_cast<float>(at_origin / frame.unit * scale);
}

}  // namespace

RenderStats render_features(const Scene& scene, Film& film, const FeatureSettings& s,
                            const Poll& poll) {
    const HostScene& host = scene.host();
    if (s.sample_end < s.sample_begin)
        fail("sample_end = " + std::to_string(s.sample_end) +
             " lies before sample_begin = " + std::to_string(s.sample_begin));
    if (film.width() != host.width || film.height() > host.height ||
        s.first_row > host.height - film.height())
        fail("the film has " + std::to_string(film.width()) + " x " +
             std::to_string(film.height()) + " pixels from row " + std::to_string(s.first_row) +
             " on, the scene's camera " + std::to_string(host.width) + " x " +
             std::to_string(host.height));
    FeatureJob job = job_of(film);
    job.first_row = s.first_row;
    const double* m = scene.input.to_world;
    const double axis[4] = {m[2], m[6], m[10],
                            -(m[2] * host.eye.x + m[6] * host.eye.y + m[10] * host.eye.z)};
    put_row(host, axis, 1, job.view.axis);
    for (int k = 0; k < 2; ++k)
        for (int i = 0; i < 3; ++i) put_row(host, s.motion[k][i], 1, job.view.motion[k][i]);
    std::vector<float> maps;
    if ((job.view.wanted >> kUvFeature & 1u) && !host.view.uv)
        maps = host.texture_maps(scene.input);
    RenderStats stats;
    const auto start = std::chrono::steady_clock::now();
    bool complete = true;
    for_sample_ranges(s, job.pixels, ~0ull, poll,
                      [&](const PathSettings& settings, uint32_t begin, SamplePart part,
                          uint32_t upper, const Poll& poll_part) {
                          if (!complete) return;
                          FaultLog faults{};
                          job.settings = settings, job.faults = &faults;
                          job.sample_begin = begin;
                          job.samples = static_cast<uint32_t>(part.samples);
                          job.centres = job.primitive.words && !begin && !upper && job.samples;
                          complete = run_features(scene, job, maps, s, stats, poll_part);
                          add_faults(stats, faults, settings, film.width(), upper);
                      });
    if (!complete) throw std::runtime_error("the render was stopped; its film is incomplete");
    stats.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return stats;
}

void put_features(const Scene& scene, const Film& film, const std::vector<Picture*>& pictures,
                  uint32_t first_row, uint64_t samples, uint32_t threads) {
    const HostScene& host = scene.host();
    if (pictures.size() + 1 != film.planes().size())
        fail(std::to_string(pictures.size()) + " pictures for a film of " +
             std::to_string(film.planes().size()) + " planes");
    uint64_t* const words = film.impl->memory->words();
    const uint64_t* hits = nullptr;
    for (size_t i = 1; i < film.planes().size(); ++i)
        if (film.planes()[i].name == kHitsPlane) hits = words + film.impl->first[i];
    if (!hits) fail(std::string("the film has no plane '") + kHitsPlane + "'");
    std::vector<PutFeature> parts;
    for (size_t i = 1; i < film.planes().size(); ++i) {
        Picture* const picture = pictures[i - 1];
        if (!picture) continue;
        const PlaneInfo& p = film.planes()[i];
        const auto* info = std::find_if(std::begin(kFeatureInfos), std::end(kFeatureInfos),
                                        [&](const FeatureInfo& f) { return p.name == f.name; });
        PutFeature part{};
        part.kind = p.kind == PlaneKind::kSumsAndSquares ? PutFeature::kMeans
                    : p.name == kHitsPlane               ? PutFeature::kShare
                                                         : PutFeature::kIntegers;
        if (picture->width() != film.width() || first_row > picture->height() ||
            film.height() > picture->height() - first_row || picture->channels() != p.channels ||
            picture->integers() != (part.kind == PutFeature::kIntegers) ||
            picture->device() != film.impl->device || p.kind == PlaneKind::kSums ||
            (part.kind == PutFeature::kMeans && info == std::end(kFeatureInfos)))
            fail("plane '" + p.name + "' does not fit into its picture from row " +
                 std::to_string(first_row) + " on");
        part.channels = p.channels, part.samples = samples;
        part.words = words + film.impl->first[i], part.hits = hits;
        part.scale = film.scale(i) != 0 ? film.scale(i) : 1.f, part.unit = 1.f;
        if (part.kind == PutFeature::kMeans && info->unit != FeatureUnit::kNone) {
            part.unit = static_cast<float>(host.unit);
            part.point = info->unit == FeatureUnit::kPoint;
            if (!part.point) part.nothing = kInfinity;
        }
        const double origin[3] = {host.centre.x, host.centre.y, host.centre.z};
        std::copy_n(origin, 3, part.origin);
        const size_t first = size_t{first_row} * film.width() * p.channels;
        part.mean = picture->impl->memory->numbers() + first;
        part.error = part.mean + picture->impl->size();
        parts.push_back(part);
    }
    film.impl->memory->put(parts, uint64_t{film.width()} * film.height(), threads);
}

}  // namespace veriray
