// Sums of pixels side by side, one per lane, in doubles; bit for bit the result of add_sample.
#pragma once

#include "film/film.h"

namespace veriray {

// The number of samples that a lane may add up. A sample is cut into parts that are multiples of
// fixed powers of two, the last of the film's resolution. Sums of that many parts have at most 53
// bits, so they are exact.
inline constexpr uint32_t kLaneSamples = 64;

// The multiple of 2^-bits nearest to x, for |x| < 2^(51 - bits).
template <int kBits, class D>
VR_HD D nearest_multiple(D x) {
    constexpr double shift = 0x1.8p52 / static_cast<double>(1ull << kBits);
    return (x + D(shift)) - D(shift);
}

// x in units of 2^-scale, rounded with halves up, for numbers of at most 48 bits. If x has no room
// for the half, the half is below 1/32.
template <int kScale, class D>
VR_HD D in_units(D x) {
    constexpr double units =
        static_cast<double>(1ull << 38) * static_cast<double>(1ull << (kScale - 38));
    return floor(x * D(units) + D(0.5));
}

template <class L>
class LaneSums {
   public:
    // sample: a channel that the film accepts, not negative, times the scale. kSquare: it is a unit
    // of its own.
    template <bool kSquare = true>
    void add(typename L::F sample) {
        const D x = to_double(sample), high = nearest_multiple<kHigh>(x);
        part_[0] = part_[0] + high;
        part_[1] = part_[1] + in_units<kSumScale>(x - high);
        if constexpr (kSquare) add_square(x);
    }
    // The same for samples of either sign.
    template <bool kSquare = true>
    void add_signed(typename L::F sample) {
        using F = typename L::F;
        const D x = to_double(abs(sample)), high = nearest_multiple<kHigh>(x);
        const D sign = to_double(select(sample < F(0.f), F(-1.f), F(1.f)));
        part_[0] = part_[0] + high * sign;
        part_[1] = part_[1] + in_units<kSumScale>(x - high) * sign;
        if constexpr (kSquare) add_square(x);
    }

    // Calls put(k, sum) for the first `count` lanes, and starts anew.
    template <class Put>
    void each_sum(uint32_t count, Put put) {
        double part[2][L::kWidth];
        for (uint32_t i = 0; i < 2; ++i) store(part[i], part_[i]), part_[i] = D(0.);
        for (uint32_t k = 0; k < count; ++k) put(k, sum_of(part[0][k], part[1][k]));
    }
    // The sum of all lanes, of which each has added one sample; starts anew.
    Fixed128 sum_of_lanes() {
        double part[2][L::kWidth], sum[2] = {};
        for (uint32_t i = 0; i < 2; ++i) {
            store(part[i], part_[i]), part_[i] = D(0.);
            for (double x : part[i]) sum[i] += x;
        }
        return sum_of(sum[0], sum[1]);
    }

    // Calls put(k, sum, sum of the squares) for the first `count` lanes.
    template <class Put>
    void each(uint32_t count, Put put) const {
        double part[5][L::kWidth];
        for (uint32_t i = 0; i < 5; ++i) store(part[i], part_[i]);
        for (uint32_t k = 0; k < count; ++k) {
            const Fixed128 sum = sum_of(part[0][k], part[1][k]);
            Fixed128 square = multiple<kTop, kSquareScale>(part[2][k]);
            veriray::add(square, multiple<kMiddle, kSquareScale>(part[3][k]));
            veriray::add(square, multiple<0, 0>(part[4][k]));
            put(k, sum, square);
        }
    }

    // Adds the sums of the first `count` lanes to a channel of their pixels.
    void flush(PixelSum* pixels, uint32_t channel, uint32_t count) const {
        each(count, [&](uint32_t k, Fixed128 sum, Fixed128 square) {
            veriray::add(pixels[k].sum[channel], sum);
            veriray::add(pixels[k].square[channel], square);
        });
    }

   private:
    using D = typename L::D;

    void add_square(D x) {
        const D square = x * x, top = nearest_multiple<kTop>(square), rest = square - top;
        const D middle = nearest_multiple<kMiddle>(rest);
        part_[2] = part_[2] + top;
        part_[3] = part_[3] + middle;
        part_[4] = part_[4] + in_units<kSquareScale>(rest - middle);
    }

    // A sample is below 2^20, and its first part leaves at most 2^-28. A square is below 2^40, and
    // its parts leave at most 2^-8 and 2^-56.
    static constexpr int kHigh = 27, kTop = 7, kMiddle = 55;

    static Fixed128 sum_of(double high, double low) {
        Fixed128 sum = multiple<kHigh, kSumScale>(high);
        veriray::add(sum, multiple<0, 0>(low));
        return sum;
    }

    // A multiple of 2^-bits as fixed point.
    template <int kBits, int kScale>
    static Fixed128 multiple(double x) {
        constexpr int shift = kScale - kBits;
        const auto n = static_cast<int64_t>(x * static_cast<double>(1ull << kBits));
        if constexpr (shift >= 64)
            return {0, static_cast<uint64_t>(n) << (shift - 64)};
        else if constexpr (shift > 0)
            return {static_cast<uint64_t>(n) << shift, static_cast<uint64_t>(n >> (64 - shift))};
        else
            return {static_cast<uint64_t>(n), n < 0 ? ~0ull : 0ull};
    }

    D part_[5] = {D(0.), D(0.), D(0.), D(0.), D(0.)};
};

}  // namespace veriray
