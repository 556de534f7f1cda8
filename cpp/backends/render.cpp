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

// Pixels that a render samples in one job.
struct Sampled {
    std::vector<uint32_t> listed;  // empty: all of the film
    bool rim = false;              // numbered as those of the film with its rim
    bool counted = true;

    uint64_t pixels(const Film& film) const {
        return listed.empty() ? static_cast<uint64_t>(film.width()) * film.height() : listed.size();
    }
};

// Those whose samples are asked for and, where pixels share samples, those that share with them, in
// and beyond the film.
std::vector<Sampled> sampled_by(const RenderSettings& s, const Film& film, uint32_t rim) {
    std::vector<Sampled> out = {{s.pixels}};
    if (!rim) return out;
    const uint32_t width = film.width() + 2 * rim, height = film.height() + 2 * rim;
    std::vector<bool> reached(static_cast<size_t>(width) * height, s.pixels.empty());
    const auto row = [&](uint32_t pixel) {
        return reached.begin() + static_cast<ptrdiff_t>(pixel / film.width()) * width +
               pixel % film.width();
    };
    for (uint32_t pixel : s.pixels)
        for (uint32_t j = 0; j <= 2 * rim; ++j)
            std::fill_n(row(pixel) + static_cast<ptrdiff_t>(j) * width, 2 * rim + 1, true);
    for (uint32_t pixel : s.pixels) row(pixel)[static_cast<ptrdiff_t>(rim) * width + rim] = false;
    Sampled within{{}, false, false}, beyond{{}, true, false};
    for (uint32_t y = 0; y < height; ++y)
        for (uint32_t x = 0; x < width; ++x) {
            const uint32_t py = y - rim;  // wraps, as px
            if (s.pixels.empty() && x == rim && py < film.height()) x += film.width();
            const uint32_t place = y * width + x, px = x - rim;
            if (!reached[place]) continue;
            if (px >= film.width() || py >= film.height())
                beyond.listed.push_back(place);
            else
                within.listed.push_back(py * film.width() + px);
        }
    for (Sampled* more : {&within, &beyond})
        if (!more->listed.empty()) out.push_back(std::move(*more));
    return out;
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

void add_faults(RenderStats& stats, const FaultLog& log, const PathSettings& settings,
                uint32_t width, uint64_t sample_high) {
    stats.fault_count += log.count;
    const int32_t rim = static_cast<int32_t>(settings.rim);
    for (uint64_t i = 0; i < std::min<uint64_t>(log.count, kMaxFaults); ++i) {
        const SampleFault& f = log.first[i];
        if (stats.faults.size() < kMaxFaults)
            stats.faults.push_back({static_cast<int32_t>((f.pixel - settings.first) % width) - rim,
                                    static_cast<int32_t>((f.pixel - settings.first) / width) - rim,
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
    const uint32_t rim = host.view.filter.rim;
    const std::vector<Sampled> parts = sampled_by(s, film, rim);
    const uint64_t samples = s.sample_end - s.sample_begin, pixels = parts[0].pixels(film);
    uint64_t all = 0;
    for (const Sampled& part : parts) all += part.pixels(film);
    const uint64_t of_all = s.pixels.empty() ? samples : 0;
    const uint64_t units = s.units && of_all ? unit_count(s.sample_begin, s.sample_end) : of_all;
    film.impl->with_more(of_all);
    RenderStats stats;
    stats.features = kVariants[choose_variant(sampled_view(host.view), s)];
    const std::unique_ptr<Runner> runner = make_runner(scene, film, s, stats);
    film.impl->match_scale(0, host.view.emission_scale);
    SharedSamples shared{nullptr, film.width() + 2 * rim, film.height() + 2 * rim,
                         1,       rim ? 2 * rim + 1 : 0,  rim ? host.view.filter.room : 1.f};
    const bool shares = rim || (s.units && !runner->adds_units());
    const uint64_t at_once =
        shares ? std::max<uint64_t>(1, runner->shared_at_once(shared.columns() * shared.rows()))
               : ~0ull;
    const auto start = std::chrono::steady_clock::now();
    bool complete = true;
    // One job of each part.
    const auto run_parts = [&](const PathSettings& settings, uint32_t begin, SamplePart now,
                               uint32_t upper, const Poll& poll_part) {
        if (!complete) return;
        Job job{};
        job.film = film.impl->view();
        job.sample_begin = begin, job.samples = static_cast<uint32_t>(now.samples);
        job.squares = now.squares;
        if (now.squares == Squares::kLater)
            job.unit = runner->units(uint64_t{film.width()} * film.height());
        if (shares) {
            shared.samples = job.samples;
            shared.numbers = runner->share(shared.columns() * shared.rows());
            job.shared = shared;
        }
        double done = 0;
        for (const Sampled& part : parts) {
            job.settings = settings;
            job.width = part.rim ? shared.width : film.width();
            if (part.rim) job.settings.rim = rim, job.settings.first = film.width() * film.height();
            job.listed = part.listed.empty() ? nullptr : part.listed.data();
            job.listed_count = static_cast<uint32_t>(part.listed.size());
            FaultLog faults{};
            job.faults = &faults;
            const double share = static_cast<double>(part.pixels(film)) / static_cast<double>(all);
            const Poll poll_job = [&](double of_job) { return poll_part(done + of_job * share); };
            complete = complete && runner->run(job, part.counted, poll_job);
            add_faults(stats, faults, job.settings, job.width, upper);
            done += share;
        }
        job.listed = s.pixels.empty() ? nullptr : s.pixels.data();
        job.listed_count = static_cast<uint32_t>(s.pixels.size());
        complete = complete &&
                   (!shares || runner->add_shared(job, [&](double) { return poll_part(done); }));
        if (complete && now.ends) runner->end_units(job, now.ends);
    };
    for_sample_ranges(s, pixels, at_once, poll, run_parts);
    if (!complete) throw std::runtime_error("the render was stopped; its film is incomplete");
    stats.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    film.impl->samples += of_all;
    film.impl->units += units;
    for (uint64_t live = samples * pixels; live;) {
        const std::vector<uint64_t> rows = runner->ledger(stats.ledger.size() / kLedgerColumns);
        if (rows.empty()) break;
        stats.ledger.insert(stats.ledger.end(), rows.begin(), rows.end());
        live = complete_ledger(stats.ledger, samples * pixels);
    }
    return stats;
}

}  // namespace veriray
