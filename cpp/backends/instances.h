// The compiled variants, and what both backends do alike around a render.
#pragma once

#include <algorithm>
#include <iterator>
#include <string>
#include <utility>

#include "api/renderer.h"
#include "integrators/integrators.h"
#include "schedulers/job.h"

namespace veriray {

// Of kIntegrators: the one that renders, so far all scenes.
inline constexpr uint32_t kIntegrator = 0;

inline uint32_t choose_variant(const SceneView& scene, const RenderSettings& s) {
    return s.all_features ? kVariantCount - 1 : variant_for(scene.features);
}

inline const SchedulerInfo* find_scheduler(const std::string& name) {
    for (const SchedulerInfo& i : kSchedulers)
        if (name == i.name) return &i;
    return nullptr;
}

// One of three by the scheduler's method.
template <class T>
T by_method(Method method, T fused, T thrust, T wavefront) {
    return method == Method::kFused ? fused : method == Method::kThrust ? thrust : wavefront;
}

inline void check_settings(const RenderSettings& s, const HostScene& scene, const Film& film) {
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
inline uint64_t pixel_count(const RenderSettings& s, const Film& film) {
    return s.pixels.empty() ? static_cast<uint64_t>(film.width()) * film.height() : s.pixels.size();
}

inline void check_film_size(uint32_t width, uint32_t height) {
    if (width == 0 || height == 0 || static_cast<uint64_t>(width) * height >= 1ull << 31)
        throw std::invalid_argument("a film of " + std::to_string(width) + " x " +
                                    std::to_string(height) + " pixels; allowed: 1 to 2^31 - 1");
}

// A film holds samples of one scale; the first render sets it.
inline void match_scale(float& scale, float other) {
    if (scale == 0) scale = other;
    if (other != 0 && scale != other)
        throw std::invalid_argument("the film holds samples of a scene of another brightness");
}

// Paths of one job at most: its 32-bit counters cannot overflow.
inline constexpr uint64_t kJobPaths = 1ull << 31;

// Calls fn(settings, begin, samples, upper, poll) for the parts of the sample range: within a part
// the upper 32 bits of the sample index are the same; poll gets the share of the whole.
template <class Fn>
void for_sample_ranges(const RenderSettings& s, uint64_t pixels, const Poll& poll, Fn fn) {
    const uint64_t largest = std::max<uint64_t>(1, kJobPaths / pixels);
    for (uint64_t at = s.sample_begin; at < s.sample_end;) {
        const uint64_t last = at | 0xffffffffull;
        const uint64_t end = s.sample_end - 1 <= last ? s.sample_end : last + 1;
        const uint64_t samples = std::min(end - at, largest);
        const uint32_t upper = static_cast<uint32_t>(at >> 32);
        PathSettings settings;
        settings.key = random_key(s.seed, upper, s.sampler);
        // 0 and 1 trace the camera segment alone.
        settings.max_depth = s.max_depth < 0 ? kHardMaxDepth : static_cast<uint32_t>(s.max_depth);
        settings.rr_depth = s.rr_depth;
        const double before = static_cast<double>(at - s.sample_begin);
        const double all = static_cast<double>(s.sample_end - s.sample_begin);
        const Poll part = [&](double share) {
            return !poll || poll((before + share * static_cast<double>(samples)) / all);
        };
        fn(settings, static_cast<uint32_t>(at), static_cast<uint32_t>(samples), upper, part);
        at += samples;
    }
}

// Fills the live column from the paths begun and the causes of their ends, and drops empty depths.
// Returns the paths that live on after the last row.
inline uint64_t complete_ledger(std::vector<uint64_t>& ledger, uint64_t paths) {
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

inline void add_faults(RenderStats& stats, const FaultLog& log, uint32_t width,
                       uint64_t sample_high) {
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

inline TreeBuilder find_builder(const std::string& name) {
    std::string names;
    for (uint32_t k = 0; k < std::size(kTreeBuilders); ++k) {
        if (name == kTreeBuilders[k]) return static_cast<TreeBuilder>(k);
        names += std::string(k ? ", " : "") + kTreeBuilders[k];
    }
    throw std::invalid_argument("builder = '" + name + "'; allowed: " + names);
}

template <uint32_t N>
TreeInfo tree_info(TreeBuilder builder, const WideTree<N>& tree, size_t memory) {
    return {kTreeBuilders[static_cast<uint32_t>(builder)],
            N,
            tree.depth,
            tree.nodes.size(),
            tree.order.size(),
            memory,
            tree.cost,
            tree.seconds};
}

}  // namespace veriray
