// Samples that count in all pixels that the filter reaches.
//
// Samples k of all pixels Q around P, one each, x_Q from P's centre and even in Q, give P one
// sample,
//     X = sum_Q f(x_Q) L_Q - sum_Q (f(x_Q) - F_Q) c_Q,   F_Q = integral of f over Q,
// where c_Q = sum_{R != Q} F_R L_R / (1 - F_Q) is what the other pixels say of L_Q. c_Q does not
// depend on x_Q, and f(x_Q) has the mean F_Q: so E X = integral of f L, whatever c_Q is. Where L
// is even, X = L without noise. With h_Q = (f(x_Q) - F_Q) / (1 - F_Q) and H = sum_Q h_Q this is
//     X = L_P + (1 - H) sum_Q F_Q (L_Q - L_P) + sum_Q h_Q (L_Q - L_P).
// The X of a pixel are independent over k, so films and their errors need not know of filters;
// those of neighbours are not independent of each other. Of noise that is independent of place, a
// gaussian of 0.5 pixels leaves 0.33 of the variance, a tent of 1 pixel 0.48. (Weighing by
// f / sum f, as is common, leaves as much, but is biased.)
#pragma once

#include "film/film.h"
#include "film/filter.h"

namespace veriray {

// Above the sum of the sizes of a sample's weights. A sample must be that much below the film's
// limit. Of all filters that share, 6.6 was the most that a search for their maxima found, and of
// lanczos 26.31 (16 lobes) is a bound: weights are linear in h_Q, whose ranges follow from those of
// f in pixels, and H is within the sum of these.
inline constexpr float kSharedRoom = 8.f, kLanczosRoom = 32.f;

// The samples of a job, which are of the film and a rim. Columns of numbers, [sample][pixel] each:
// red, green, blue; then by pixel from its own, along x and then along y, the filter's density at
// the sample. Before weigh_sample the first of each of these is the place in the pixel, in [0, 1).
struct SharedSamples {
    float* numbers;  // null: samples are not shared
    uint32_t width, height, samples;
    uint32_t reach;  // pixels along an axis in which a sample counts; 0: one, and colours alone
    float room;      // of the filter

    VR_HD uint32_t columns() const { return 3 + 2 * reach; }
    VR_HD uint64_t rows() const { return static_cast<uint64_t>(width) * height * samples; }
    VR_HD float* number(uint32_t column, uint64_t row) const {
        return numbers + column * rows() + row;
    }
    VR_HD uint64_t row(uint32_t sample, uint32_t pixel) const {
        return static_cast<uint64_t>(width) * height * sample + pixel;
    }
};

// Rows from `row` on, one per lane.
template <class L>
VR_HD void weigh_sample(const FilterView& f, const SharedSamples& s, uint64_t row) {
    using F = typename L::F;
    for (uint32_t first = 3; first < s.columns(); first += s.reach) {
        const F at = load(s.number(first, row), F());
        for (uint32_t i = 0; i < s.reach; ++i) {
            const float pixel = static_cast<float>(i) - static_cast<float>(f.rim) - 0.5f;
            store(s.number(first + i, row), filter_at(f, at + F(pixel)));
        }
    }
}

// Sample k of pixels from (x, y) on, one per lane.
template <class L>
VR_HD Spectrum<typename L::F> shared_sample(const FilterView& f, const SharedSamples& s, uint32_t x,
                                            uint32_t y, uint32_t k) {
    using F = typename L::F;
    const auto row = [&](uint32_t i, uint32_t j) { return s.row(k, (y + j) * s.width + x + i); };
    const auto colour = [&](uint64_t at) {
        return Spectrum<F>::of([&](uint32_t c) { return load(s.number(c, at), F()); });
    };
    const Spectrum<F> middle = colour(row(f.rim, f.rim));
    if (!s.reach) return middle;
    Spectrum<F> even = Spectrum<F>::all(F(0.f)), rest = even;
    F sum(0.f);
    for (uint32_t j = 0; j < s.reach; ++j)
        for (uint32_t i = 0; i < s.reach; ++i) {
            const uint64_t at = row(i, j);
            const F part(f.part(i) * f.part(j));
            const F h = fma(load(s.number(3 + i, at), F()),
                            load(s.number(3 + s.reach + j, at), F()), -part) *
                        F(f.others(i, j));
            const Spectrum<F> there = colour(at);
            sum = sum + h;
            for (uint32_t c = 0; c < 3; ++c) {
                const F more = there[c] - middle[c];
                even[c] = fma(more, part, even[c]);
                rest[c] = fma(more, h, rest[c]);
            }
        }
    return middle + (even * (F(1.f) - sum) + rest);
}

}  // namespace veriray
