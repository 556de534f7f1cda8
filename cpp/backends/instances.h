// The compiled variants, and what both backends need to run them.
#pragma once

#include <algorithm>
#include <iterator>
#include <string>

#include "api/renderer.h"
#include "schedulers/job.h"

namespace veriray {

// Of kIntegrators: the one that renders, so far all scenes.
inline constexpr uint32_t kIntegrator = 0;

uint32_t choose_variant(const SceneView& scene, const RenderSettings& s,
                        uint32_t of = kEveryVariant);

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

// Paths of one job at most: its 32-bit counters cannot overflow.
inline constexpr uint64_t kJobPaths = 1ull << 31;

// What a job does with samples [begin, begin + samples): whole units, of which the range cuts the
// first and the last, or a part of one; ends: the samples of a unit that it completes.
struct SamplePart {
    uint64_t samples;
    Squares squares = Squares::kOfSamples;
    uint32_t ends = 0;
};
// The next part of [at, end), of `most` samples at most.
inline SamplePart next_part(const RenderSettings& s, uint64_t at, uint64_t end, uint64_t most) {
    const uint64_t left = end - at, n = std::min(left, most);
    if (!s.units) return {n};
    const bool begun = at != s.sample_begin && at != unit_begin(at);
    const uint64_t last = n == left ? end : unit_begin(at + n);
    if (!begun && last > at) return {last - at, Squares::kOfUnits};
    const uint64_t stop = std::min(unit_end(at), end), parts = (stop - at + n - 1) / n;
    const uint64_t begin = std::max(unit_begin(at), s.sample_begin);
    return {(stop - at + parts - 1) / parts, Squares::kLater,
            parts == 1 ? static_cast<uint32_t>(stop - begin) : 0};
}

// Calls fn(settings, begin, part, upper, poll) for the parts of the sample range: within a part the
// upper 32 bits of the sample index are the same; poll gets the share of the whole. most: as of
// next_part.
template <class Fn>
void for_sample_ranges(const RenderSettings& s, uint64_t pixels, uint64_t most, const Poll& poll,
                       Fn fn) {
    const uint64_t largest = std::max<uint64_t>(1, std::min(most, kJobPaths / pixels));
    for (uint64_t at = s.sample_begin; at < s.sample_end;) {
        const uint64_t last = at | 0xffffffffull;
        const uint64_t end = s.sample_end - 1 <= last ? s.sample_end : last + 1;
        const SamplePart next = next_part(s, at, end, largest);
        const uint64_t samples = next.samples;
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
        fn(settings, static_cast<uint32_t>(at), next, upper, part);
        at += samples;
    }
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
