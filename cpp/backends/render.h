// What a back end does for one render; render.cpp calls it.
#pragma once

#include <memory>
#include <vector>

#include "api/renderer.h"
#include "schedulers/job.h"

namespace veriray {

class Runner {
   public:
    virtual ~Runner() = default;
    // Runs a job whose pixel list and fault log lie in the host's memory. Returns false if poll
    // stopped it.
    virtual bool run(const Job& job, const Poll& poll) = 0;
    // Rows of the ledger, all jobs' sums, from `first` on, some at a time; none after the last.
    virtual std::vector<uint64_t> ledger(uint64_t first) = 0;
};
void add_faults(RenderStats& stats, const FaultLog& log, uint32_t width, uint64_t sample_high);

// Checks what its machine asks of the settings; notes that machine in the statistics.
std::unique_ptr<Runner> make_runner(const Scene& scene, const Film& film, const RenderSettings& s,
                                    RenderStats& stats);

}  // namespace veriray
