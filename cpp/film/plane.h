// The planes of a film, and how stages add to those beside radiance.
//
// All numbers of a film are 128-bit integers, so that films of any planes are added, saved and
// restored alike. A sample of a plane of sums enters as radiance does (film.h), with a scale of the
// plane's own; integers enter as they are, and 2^64 of them cannot overflow.
#pragma once

#include "film/film.h"

namespace veriray {

enum class PlaneKind : uint32_t { kSumsAndSquares, kSums, kIntegers };
inline constexpr const char* kPlaneKinds[] = {"sums and squares", "sums", "integers"};
// Words of a channel: the sum, low word first, then the sum of squares.
inline constexpr uint32_t kPlaneWords[] = {4, 2, 2};

struct PlaneView {
    uint64_t* words;  // [pixel][channel][kPlaneWords]
    uint32_t channels;
    bool squares, negative;
    float scale;  // 2^-e: samples of 2^(20 + e) or more are refused; of integers 0

    VR_HD uint64_t* number(uint32_t pixel, uint32_t channel) const {
        return words + (static_cast<uint64_t>(pixel) * channels + channel) * (squares ? 4u : 2u);
    }
};

// Threads may add to one number at once.
VR_HD void add_to_number(uint64_t* number, Fixed128 x) {
    const uint64_t before = atomic_add(number, x.lo);
    const uint64_t high = x.hi + (before + x.lo < x.lo ? 1u : 0u);
    if (high) atomic_add(number + 1, high);
}

// x: a sample's channels. Where the plane refuses one it takes none: the sample is logged (its
// first three channels, or the last again), and the answer false.
VR_HD bool add_values(const PlaneView& plane, FaultLog* faults, uint32_t pixel, uint32_t sample,
                      const float* x) {
    for (uint32_t c = 0; c < plane.channels; ++c) {
        if (abs(x[c] * plane.scale) < kSampleLimit && (x[c] >= 0.f || plane.negative)) continue;
        const uint32_t last = plane.channels - 1;
        log_fault(faults, pixel, sample, {{x[0], x[last < 1 ? last : 1], x[last < 2 ? last : 2]}});
        return false;
    }
    for (uint32_t c = 0; c < plane.channels; ++c) {
        PixelSum one{};
        add_sample(one, 0, x[c] * plane.scale);
        add_to_number(plane.number(pixel, c), one.sum[0]);
        if (plane.squares) add_to_number(plane.number(pixel, c) + 2, one.square[0]);
    }
    return true;
}

VR_HD void add_integers(const PlaneView& plane, uint32_t pixel, const uint64_t* x) {
    for (uint32_t c = 0; c < plane.channels; ++c) add_to_number(plane.number(pixel, c), {x[c], 0});
}

}  // namespace veriray
