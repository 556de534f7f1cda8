// Radiance in the film: per pixel and channel, the exact sums of the samples and of the squares of
// their units' sums (film/units.h) over their numbers of samples; a unit may be one sample.
//
// A sample x (radiance) is added as round(x 2^-e 2^72) and round((x 2^-e)^2 2^76) in 128-bit
// integers, where e is the binary exponent of the scene's largest radiance. Integer addition is
// associative, so any order, split, merge or resume gives the same film, no sum drifts, and threads
// need no order. The resolution per sample is 2^-72 of the largest radiance, and 2^-76 for its
// square: small standard errors of pixels below kDim of it are upper bounds. A sample that is at or
// above 2^20 times the largest radiance, not finite, or negative although its integrator gives no
// such samples, is not added, but counted and reported (SampleFault). Sums are signed, because a
// filter with negative lobes subtracts.
#pragma once

#include "core/fixed.h"
#include "film/units.h"
#include "spectrum/spectrum.h"

namespace veriray {

inline constexpr int kSumScale = 72;
inline constexpr int kSquareScale = 76;
inline constexpr float kSampleLimit = 0x1p20f;
inline constexpr double kDim = 0x1p-28;     // of the largest radiance: squares below are rounded
inline constexpr uint32_t kFilmWords = 12;  // sum lo, hi and square lo, hi of three channels

struct FilmView {
    uint64_t* words;  // [pixel][channel][sum lo, sum hi, square lo, square hi]
    uint32_t width, height;
    float scale;  // 2^-e
};

struct PixelSum {
    Fixed128 sum[3], square[3];
};

// True where a film takes the sample; false also for NaN. kNegative: one below 0 is legitimate.
template <bool kNegative, class F>
VR_HD auto film_accepts(const Spectrum<F>& radiance, float scale) {
    const F limit(kSampleLimit), zero(0.f), s(scale);
    if constexpr (kNegative)
        return (abs(radiance[0] * s) < limit) & (abs(radiance[1] * s) < limit) &
               (abs(radiance[2] * s) < limit);
    else
        return (radiance[0] >= zero) & (radiance[1] >= zero) & (radiance[2] >= zero) &
               (radiance[0] * s < limit) & (radiance[1] * s < limit) & (radiance[2] * s < limit);
}

// x: a channel of a sample that the film accepts, times the filter's weight and the scale.
// square: it is a unit of its own.
VR_HD void add_sample(PixelSum& p, int channel, float x, bool square = true) {
    const uint32_t bits = bit_cast<uint32_t>(x) & 0x7fffffffu;
    const uint64_t m = (bits & 0x7fffffu) | 0x800000u;  // |x| = m 2^exponent; 2^-126 counts as 0
    const int exponent = static_cast<int>(bits >> 23) - 150;
    const Fixed128 size = to_fixed(m, exponent + kSumScale);
    add(p.sum[channel], x < 0 ? negated(size) : size);
    if (square) add(p.square[channel], to_fixed(m * m, 2 * exponent + kSquareScale));
}
VR_HD void add_sample(PixelSum& p, const Spectrum<float>& x, bool square = true) {
    add_sample(p, 0, x[0], square);
    add_sample(p, 1, x[1], square);
    add_sample(p, 2, x[2], square);
}
// Sums of a unit of n samples get their squares over n.
static_assert(2 * kSumScale - kSquareScale == 68);
VR_HD void end_unit(PixelSum& p, uint32_t n) {
    for (int c = 0; c < 3; ++c) {
        const Fixed128 square = squared(p.sum[c]);
        p.square[c] = n == kGroupSamples
                          ? Fixed128{square.lo >> kGroupDigits | square.hi << (64 - kGroupDigits),
                                     square.hi >> kGroupDigits}
                          : divided(square, n);
    }
}

// Several threads may add to one pixel at once. Three additions at a time return their carries; six
// would take 8 more registers.
VR_HD void add_three(uint64_t* out, uint32_t stride, const Fixed128* part) {
    uint64_t before[3];
    for (uint32_t k = 0; k < 3; ++k) before[k] = atomic_add(out + stride * k, part[k].lo);
    for (uint32_t k = 0; k < 3; ++k) {
        const uint64_t high = part[k].hi + (before[k] + part[k].lo < part[k].lo ? 1u : 0u);
        if (high) atomic_add(out + stride * k + 1, high);
    }
}
VR_HD void flush(const FilmView& film, uint32_t pixel, PixelSum& p) {
    uint64_t* w = film.words + static_cast<uint64_t>(pixel) * kFilmWords;
    add_three(w, 4, p.sum);
    add_three(w + 2, 4, p.square);
    p = {};
}

// Units that are not complete: their sums by pixel and channel, low word first.
inline constexpr uint32_t kUnitWords = 6;
VR_HD void add_to_unit(uint64_t* units, uint32_t pixel, PixelSum& p) {
    add_three(units + static_cast<uint64_t>(pixel) * kUnitWords, 2, p.sum);
    p = {};
}
// The sums of a pixel's unit, of which nothing is left.
VR_HD PixelSum take_unit(uint64_t* units, uint32_t pixel) {
    uint64_t* w = units + static_cast<uint64_t>(pixel) * kUnitWords;
    PixelSum p{};
    for (uint32_t c = 0; c < 3; ++c) {
        p.sum[c] = {w[2 * c], w[2 * c + 1]};
        w[2 * c] = w[2 * c + 1] = 0;
    }
    return p;
}

VR_HD double film_sum(const uint64_t* words, uint32_t channel, float scale) {
    return to_double({words[4 * channel], words[4 * channel + 1]}, kSumScale) /
           static_cast<double>(scale);
}

struct Estimate {
    double mean, squared_error;  // times the film's scale
};

// Mean and squared error of the mean of the first channel over n samples in k independent
// units. Of units of n_j samples and sums S_j, with the mean m of all samples,
//     sum_j (S_j - n_j m)^2 / n_j = sum_j S_j^2 / n_j - n m^2
// has the mean (k - 1) v, where v is n times the variance of m.
// The variance is a difference of two numbers. If all samples are equal, rounding (2^-52 of the
// square) may make it negative; it is then set to 0. What is not far above the rounding of the
// samples' squares gets a bound on that. Sums of squares of more than 2^51 times the square of the
// largest radiance do not fit: then it is infinite.
VR_HD Estimate estimate(const PixelSum& p, uint64_t n, uint64_t k) {
    const double count = static_cast<double>(n);
    const double m = n ? to_double(p.sum[0], kSumScale) / count : 0.0;
    if (k < 2) return {m, 0.0};
    if (p.square[0].hi >> 63) return {m, bit_cast<double>(uint64_t{0x7ff} << 52)};
    const double variance = to_double(p.square[0], kSquareScale) / count - m * m;
    const bool dim = m != 0.0 && m < kDim && m > -kDim && variance < 0x1p-70;
    const double known = (variance > 0 ? variance : 0.0) + (dim ? 0x1p-76 : 0.0);
    return {m, known / (static_cast<double>(k) - 1.0)};
}
// One channel of a pixel's words, as the first of three.
VR_HD PixelSum channel_of(const uint64_t* words) {
    return {{{words[0], words[1]}}, {{words[2], words[3]}}};
}
// In radiance.
VR_HD void resolve(const Estimate& e, float scale, float& mean, float& standard_error) {
    const double unit = 1.0 / static_cast<double>(scale);
    mean = static_cast<float>(e.mean * unit);
    standard_error = static_cast<float>(ieee_sqrt(e.squared_error) * unit);
}

// The same of k whole units of w samples together, and t more of a unit that is cut, which may
// spread more or less than the others. With the mean M of the whole units, its squared error s^2,
// the mean m of all n samples and the sum T of the t, m - M = (T - t M) / n, so
//     n^2 E (m - M)^2 = var T + t^2 s^2 and n^2 var m = w^2 s^2 + var T:
// (w^2 - t^2) s^2 / n^2 + (m - M)^2 has the mean var m. With one whole unit both count as whole.
VR_HD Estimate estimate_cut(PixelSum all, const PixelSum& tail, uint64_t w, uint64_t t,
                            uint64_t k) {
    const Estimate whole = estimate(all, w, k);
    add(all.sum[0], tail.sum[0]);
    add(all.square[0], tail.square[0]);
    const Estimate both = estimate(all, w + t, k + 1);
    if (k < 2) return both;
    const double n = static_cast<double>(w + t), a = static_cast<double>(w) / n,
                 b = static_cast<double>(t) / n, off = both.mean - whole.mean;
    return {both.mean, (a * a - b * b) * whole.squared_error + off * off};
}

// A sample that the film refused: enough to replay it.
struct SampleFault {
    uint32_t pixel, sample;
    float radiance[3];
};
inline constexpr uint32_t kMaxFaults = 64;
struct FaultLog {
    uint64_t count;
    SampleFault first[kMaxFaults];
};

VR_HD void log_fault(FaultLog* log, uint32_t pixel, uint32_t sample,
                     const Spectrum<float>& radiance) {
    const uint64_t k = atomic_add(&log->count, 1);
    if (k < kMaxFaults) log->first[k] = {pixel, sample, {radiance[0], radiance[1], radiance[2]}};
}

}  // namespace veriray
