// Feature images on a CPU: pixels side by side, whose samples are summed by lanes.
#include <thread>

#include "backends/features.h"
#include "backends/render.h"
#include "film/lane_sums.h"
#include "integrators/features.h"
#include "scene/thread_pool.h"

namespace veriray {
namespace {

using F = Simd::F;
using U = Simd::U;
using M = Simd::M;

// The pixels of the lanes, up to `end`; those beyond repeat the first.
struct Lanes {
    uint32_t live;
    U x, y;
    M active;

    Lanes(const FeatureJob& job, uint32_t pixel, uint32_t end) {
        live = std::min(end - pixel, Simd::kWidth);
        uint32_t xs[Simd::kWidth], ys[Simd::kWidth];
        for (uint32_t k = 0; k < Simd::kWidth; ++k) {
            const uint32_t at = k < live ? pixel + k : pixel;
            xs[k] = at % job.width, ys[k] = job.first_row + at / job.width;
        }
        x = load(xs, U()), y = load(ys, U());
        active = first_lanes(live, M());
    }
};

void add_plain(uint64_t* number, Fixed128 x) {  // a pixel belongs to one thread
    Fixed128 sum{number[0], number[1]};
    add(sum, x);
    number[0] = sum.lo, number[1] = sum.hi;
}

void log_lanes(const FeatureJob& job, FeatureKind kind, uint32_t pixel, uint32_t sample,
               uint32_t refused, const F* numbers) {
    float x[3][Simd::kWidth] = {};
    for (uint32_t c = 0; c < job.planes[kind].channels; ++c) store(x[c], numbers[c]);
    for (uint32_t k = 0; k < Simd::kWidth; ++k) {
        const float one[3] = {x[0][k], x[1][k], x[2][k]};
        if (refused >> k & 1u) log_refused(job, kind, pixel + k, sample, one);
    }
}

// Samples [first, last) of pixels side by side, at most kLaneSamples.
template <class Looker>
void look_at(const SceneView& scene, const FeatureJob& job, uint32_t pixel, const Lanes& lanes,
             uint32_t first, uint32_t last) {
    LaneSums<Simd> sums[kMostFeatureChannels];
    U hits(0u);
    for (uint32_t s = first; s < last; ++s) {
        const uint32_t sample = job.sample_begin + s;
        auto path =
            Looker::begin(scene, job.settings, lanes.x, lanes.y, job.width, U(sample), false);
        const auto put = [&](FeatureKind kind, const F* x, M met) {
            const PlaneView& plane = job.planes[kind];
            const M good = met & feature_accepted(plane, x);
            if (const M bad = met & !good; any(bad))
                log_lanes(job, kind, pixel, sample, bits(bad), x);
            for (uint32_t c = 0; c < plane.channels; ++c)
                sums[job.first[kind] + c].add_signed(select(good, x[c] * F(plane.scale), F(0.f)));
        };
        const M met = Looker::look(scene, job.settings, job.view, path, lanes.active, put);
        hits = hits + select(met, U(1u), U(0u));
    }
    uint32_t count[Simd::kWidth];
    store(count, hits);
    for (uint32_t k = 0; k < lanes.live; ++k)
        add_plain(job.hits.number(pixel + k, 0), {count[k], 0});
    for (uint32_t kind = 0; kind < kFeatureKinds; ++kind) {
        if (!(job.view.wanted >> kind & 1u)) continue;
        const PlaneView& plane = job.planes[kind];
        for (uint32_t c = 0; c < plane.channels; ++c) {
            sums[job.first[kind] + c].each(lanes.live,
                                           [&](uint32_t k, Fixed128 sum, Fixed128 square) {
                                               add_plain(plane.number(pixel + k, c), sum);
                                               add_plain(plane.number(pixel + k, c) + 2, square);
                                           });
        }
    }
}

// Pixels and samples of a unit of work, which no poll interrupts.
constexpr uint32_t kRun = 256, kAtOnce = 4096;
static_assert(kRun % Simd::kWidth == 0);

// Without calls, which pass vectors through memory: half of the time.
template <class Looker>
[[gnu::flatten]] void look_at_run(const SceneView& scene, const FeatureJob& job, uint32_t begin,
                                  uint32_t end) {
    for (uint32_t pixel = begin; pixel < end; pixel += Simd::kWidth) {
        const Lanes lanes(job, pixel, end);
        for (uint32_t at = 0; at < job.samples; at += kLaneSamples)
            look_at<Looker>(scene, job, pixel, lanes, at,
                            std::min(job.samples - at, kLaneSamples) + at);
        if (!job.centres) continue;
        uint32_t id[Simd::kWidth];
        store(id, Looker::primitive_at_centre(scene, job.settings, lanes.x, lanes.y, job.width,
                                              lanes.active));
        for (uint32_t k = 0; k < lanes.live; ++k)
            add_plain(job.primitive.number(pixel + k, 0), {id[k], 0});
    }
}

}  // namespace

bool run_features(const Scene& scene, const FeatureJob& job, const std::vector<float>& maps,
                  const RenderSettings& s, RenderStats& stats, const Poll& poll) {
    SceneView view = traced_view(scene.host().view);
    if (!maps.empty()) view.uv = maps.data();
    stats.threads = s.threads ? s.threads : std::max(1u, std::thread::hardware_concurrency());
    stats.device = "cpu";
    ++stats.launches;
    FeatureJob part = job;
    const auto look = [&](uint32_t, uint64_t unit) {
        const auto begin = static_cast<uint32_t>(unit * kRun);
        with_feature_variant(needed(view), s.all_features, [&]<uint32_t kVariant>() {
            look_at_run<FeatureImages<Simd, kVariant>>(view, part, begin,
                                                       std::min(job.pixels - begin, kRun) + begin);
        });
    };
    for (uint32_t first = 0; first < job.samples; first += part.samples) {
        part.sample_begin = job.sample_begin + first;
        part.samples = std::min(job.samples - first, kAtOnce);
        part.centres = job.centres && !first;
        const auto share = [&](double of_part) {
            return !poll || poll((first + of_part * part.samples) / job.samples);
        };
        if (!parallel(stats.threads, (uint64_t{job.pixels} + kRun - 1) / kRun, share, look))
            return false;
    }
    return true;
}

}  // namespace veriray
