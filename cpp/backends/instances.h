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
