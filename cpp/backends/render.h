// What a back end does for one render; render.cpp calls it.
#pragma once

#include <memory>
#include <vector>

#include "api/renderer.h"
#include "schedulers/job.h"

namespace veriray {

// A scene as its stages see it, with what follows from its features.
inline SceneView traced_view(SceneView view) {
    view.parameters = 0;
    for (uint32_t kind = 0; kind < kMaterialCount; ++kind)
        if (kinds_of(view.features) >> kind & 1u) view.parameters |= closure_traits(kind).reads;
    return view;
}
// Likewise as pictures sample it: evenly in pixels where these share samples.
inline SceneView sampled_view(SceneView view) {
    if (view.filter.rim) view.filter.kind = FilterKind::kBox;
    return traced_view(view);
}

class Runner {
   public:
    virtual ~Runner() = default;
    // Samples of each pixel that the machine shares at once, if one of all pixels is so many
    // numbers; 0: less than one, which it does all the same. Room for the numbers of a job.
    virtual uint64_t shared_at_once(uint64_t numbers) const = 0;
    virtual float* share(uint64_t numbers) = 0;
    // Runs a job whose pixel list and fault log lie in the host's memory. counted: its paths count
    // in ledger and statistics. Returns false if poll stopped it.
    virtual bool run(const Job& job, bool counted, const Poll& poll) = 0;
    // Adds what a job's film makes of the samples that it shares; its listed pixels, or all.
    // Returns false if poll stopped it; on a GPU it takes milliseconds, and does not poll.
    virtual bool add_shared(const Job& job, const Poll& poll) = 0;
    // Whether its schedulers add units to the film where no filter shares samples; else they are
    // handed on as shared ones.
    virtual bool adds_units() const = 0;
    // Room for the sums of units of all pixels that are cut by jobs; 0 when it is made.
    virtual uint64_t* units(uint64_t pixels) = 0;
    // The units of the job's pixels are complete; n: their samples.
    virtual void end_units(const Job& job, uint32_t n) = 0;
    // Rows of the ledger, all jobs' sums, from `first` on, some at a time; none after the last.
    virtual std::vector<uint64_t> ledger(uint64_t first) = 0;
};
void add_faults(RenderStats& stats, const FaultLog& log, const PathSettings& settings,
                uint32_t width, uint64_t sample_high);

// Checks what its machine asks of the settings; notes that machine in the statistics.
std::unique_ptr<Runner> make_runner(const Scene& scene, const Film& film, const RenderSettings& s,
                                    RenderStats& stats);

}  // namespace veriray
