// A render, on either machine.
#include "backends/render.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "backends/film_memory.h"
#include "backends/instances.h"
#include "scene/variants.h"

namespace veriray {
namespace {

void check_settings(const RenderSettings& s, const HostScene& scene, const Film& film) {
    const auto fail = [](const std::string& text) { throw std::invalid_argument(text); };
    if (s.sample_end < s.sample_begin)
        fail("sample_end = " + std::to_string(s.sample_end) +
             " lies before sample_begin = " + std::to_string(s.sample_begin));
    if (s.max_depth < -1 || s.max_depth > kHardMaxDepth)
        fail("max_depth = " + std::to_string(s.max_depth) + "; allowed: -1 (unlimited) to " +
             std::to_string(kHardMaxDepth));
    if (!find_scheduler(s.scheduler)) {
        std::string names;
        for (const SchedulerInfo& i : kSchedulers) names += std::string(", ") + i.name;
        fail("scheduler = '" + s.scheduler + "'; allowed: " + names.substr(2));
    }
    if (s.batch > 1u << 26) fail("batch = " + std::to_string(s.batch) + "; allowed: 0 to 2^26");
    if (film.width() != scene.width || film.height() != scene.height)
        fail("the film has " + std::to_string(film.width()) + " x " +
             std::to_string(film.height()) + " pixels, the scene's camera " +
             std::to_string(scene.width) + " x " + std::to_string(scene.height));
    const uint64_t all = static_cast<uint64_t>(film.width()) * film.height();
    for (size_t i = 0; i < s.pixels.size(); ++i)
        if (s.pixels[i] >= all || (i && s.pixels[i] <= s.pixels[i - 1]))
            fail("pixels[" + std::to_string(i) + "] = " + std::to_string(s.pixels[i]) +
                 "; allowed: ascending numbers below " + std::to_string(all));
}

// Pixels that a render draws samples of.
uint64_t pixel_count(const RenderSettings& s, const Film& film) {
    return s.pixels.empty() ? static_cast<uint64_t>(film.width()) * film.height() : s.pixels.size();
}

// Fills the live column from the paths begun and the causes of their ends, and drops empty depths.
// Returns the paths that live on after the last row.
uint64_t complete_ledger(std::vector<uint64_t>& ledger, uint64_t paths) {
    uint64_t live = paths;
    size_t depths = 0;
    for (; depths * kLedgerColumns < ledger.size() && live; ++depths) {
        uint64_t* row = &ledger[depths * kLedgerColumns];
        row[kLive] = live;
        for (uint32_t c = kEscaped; c <= kInvalid; ++c) live -= row[c];
    }
    ledger.resize(depths * kLedgerColumns);
    return live;
}

}  // namespace

void add_faults(RenderStats& stats, const FaultLog& log, uint32_t width, uint64_t sample_high) {
    stats.fault_count += log.count;
    for (uint64_t i = 0; i < std::min<uint64_t>(log.count, kMaxFaults); ++i) {
        const SampleFault& f = log.first[i];
        if (stats.faults.size() < kMaxFaults)
            stats.faults.push_back({f.pixel % width,
                                    f.pixel / width,
                                    sample_high << 32 | f.sample,
                                    {f.radiance[0], f.radiance[1], f.radiance[2]}});
    }
    std::sort(stats.faults.begin(), stats.faults.end(), [](const Fault& a, const Fault& b) {
        return std::pair(a.sample, std::pair(a.y, a.x)) < std::pair(b.sample, std::pair(b.y, b.x));
    });
}

uint32_t choose_variant(const SceneView& scene, const RenderSettings& s, uint32_t of) {
    return s.all_features ? kVariantCount - 1 : variant_for(scene.features, of);
}

FeatureMask variant_mask(const SceneView& scene) { return kVariants[variant_for(scene.features)]; }

std::vector<FeatureMask> variant_masks() { return {std::begin(kVariants), std::end(kVariants)}; }

RenderStats render(const Scene& scene, Film& film, const RenderSettings& s, const Poll& poll) {
    const HostScene& host = scene.host();
    check_settings(s, host, film);
    const uint64_t samples = s.sample_end - s.sample_begin, pixels = pixel_count(s, film);
    const uint64_t of_all = s.pixels.empty() ? samples : 0;
    film.impl->with_more(of_all);
    RenderStats stats;
    stats.features = kVariants[choose_variant(host.view, s)];
    const std::unique_ptr<Runner> runner = make_runner(scene, film, s, stats);
    film.impl->match_scale(0, host.view.emission_scale);
    const auto start = std::chrono::steady_clock::now();
    bool complete = true;
    for_sample_ranges(s, pixels, poll,
                      [&](const PathSettings& settings, uint32_t begin, uint32_t count,
                          uint32_t upper, const Poll& part) {
                          if (!complete) return;
                          FaultLog faults{};
                          complete =
                              runner->run({settings, film.impl->view(), &faults, begin, count,
                                           s.pixels.empty() ? nullptr : s.pixels.data(),
                                           static_cast<uint32_t>(s.pixels.size())},
                                          part);
                          add_faults(stats, faults, film.width(), upper);
                      });
    if (!complete) throw std::runtime_error("the render was stopped; its film is incomplete");
    stats.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    film.impl->samples += of_all;
    for (uint64_t live = samples * pixels; live;) {
        const std::vector<uint64_t> rows = runner->ledger(stats.ledger.size() / kLedgerColumns);
        if (rows.empty()) break;
        stats.ledger.insert(stats.ledger.end(), rows.begin(), rows.end());
        live = complete_ledger(stats.ledger, samples * pixels);
    }
    return stats;
}

}  // namespace veriray
