// Units: samples of a pixel, one after another, whose sum is squared for the error: single ones, or
// groups of 16 of sampler `sobol` (core/sobol.h), whose samples are not independent of each other.
#pragma once

#include "core/sobol.h"

namespace veriray {

// How the samples of a job enter sums of squares: each alone; by units, of which the job cuts the
// first and the last; or later, as the job is a part of a unit of each pixel.
enum class Squares : uint32_t { kOfSamples, kOfUnits, kLater };

VR_HD uint64_t unit_begin(uint64_t sample) { return sample - sample % kGroupSamples; }
VR_HD uint64_t unit_end(uint64_t sample) { return unit_begin(sample) + kGroupSamples; }

// Units of samples [begin, end), begin < end.
VR_HD uint64_t unit_count(uint64_t begin, uint64_t end) {
    return (end - 1) / kGroupSamples - begin / kGroupSamples + 1;
}

}  // namespace veriray
