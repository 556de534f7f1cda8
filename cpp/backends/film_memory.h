// What a film is, whatever memory it lies in: film.cpp. Each back end has its FilmMemory.
#pragma once

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "api/renderer.h"

namespace veriray {

// Of arguments that a film, a render or feature images do not take.
[[noreturn]] inline void fail(const std::string& text) { throw std::invalid_argument(text); }

// Sum of all standard errors, in 2^-kSumScale of the film's scale; how many are not finite.
struct ErrorSum {
    Fixed128 sum;
    uint64_t not_finite;
};

// The numbers of a picture: means, then standard errors; or the bits of integers.
class PictureMemory {
   public:
    virtual ~PictureMemory() = default;
    virtual float* numbers() = 0;  // where the device has them
    virtual void read(size_t first, size_t n, float* out) const = 0;
    // From now on others may read them on the device; see Picture::share.
    virtual void share() {}
};

// Room for n numbers. Throws as film_memory.
std::unique_ptr<PictureMemory> picture_memory(size_t n, int device);

struct PutFeature;

// The samples of pixels, and their units.
struct SampleCount {
    uint64_t samples, units;
    const uint64_t* by_pixel;  // or null: all have the same number
    bool groups;               // those by pixel are in units of kGroupSamples, not alone
    const uint64_t* tail;      // or null: sums of each pixel's last unit, which is cut

    VR_HD uint64_t of(uint64_t pixel, uint64_t& of_units) const {
        const uint64_t n = by_pixel ? by_pixel[pixel] : samples;
        of_units = !by_pixel ? units : groups && n ? unit_count(0, n) : n;
        return n;
    }
};

// The words of a film.
class FilmMemory {
   public:
    virtual ~FilmMemory() = default;
    virtual uint64_t* words() = 0;  // as stages see them
    virtual void clear() = 0;
    virtual void read(size_t first, size_t n, uint64_t* out) const = 0;
    // Adds 128-bit numbers: those of a film of as many, maybe on another device, or n words of the
    // host's from `first` on.
    virtual void add(const FilmMemory& other) = 0;
    virtual void add(size_t first, size_t n, const uint64_t* from) = 0;
    // See Picture. The film's radiance, or another plane with squares of some channels, which has
    // the film's layout.
    virtual std::unique_ptr<PictureMemory> resolve(const FilmView& film, uint32_t channels,
                                                   const SampleCount& count, uint32_t threads,
                                                   ErrorSum& sum) const = 0;
    // Makes the sums of the radiance those of one unit of n samples.
    virtual void end_unit(const FilmView& film, uint32_t n) = 0;
    // Makes what is asked for of each of the first pixels.
    virtual void put(const std::vector<PutFeature>& parts, uint64_t pixels,
                     uint32_t threads) const = 0;
};
// Zeros. Throws OutOfMemoryError, and DeviceError for a device that there is not.
std::unique_ptr<FilmMemory> film_memory(size_t words, int device);

// What is done to the i-th number of a film, or to the i-th channel of a plane with squares.
struct AddNumbers {
    uint64_t* a;
    const uint64_t* b;
    VR_HD void operator()(uint64_t i) const {
        Fixed128 x{a[2 * i], a[2 * i + 1]};
        add(x, {b[2 * i], b[2 * i + 1]});
        a[2 * i] = x.lo;
        a[2 * i + 1] = x.hi;
    }
};
struct EndUnit {
    FilmView film;
    uint32_t n;
    VR_HD void operator()(uint64_t i) const {
        uint64_t* w = film.words + i * kFilmWords;
        PixelSum p{};
        for (uint32_t c = 0; c < 3; ++c) p.sum[c] = {w[4 * c], w[4 * c + 1]};
        veriray::end_unit(p, n);
        for (uint32_t c = 0; c < 3; ++c)
            w[4 * c + 2] = p.square[c].lo, w[4 * c + 3] = p.square[c].hi;
    }
};
struct ResolveChannels {
    FilmView film;
    uint32_t channels;
    SampleCount count;
    float *mean, *error;
    VR_HD void operator()(uint64_t i, ErrorSum& sum) const {
        uint64_t units;
        const uint64_t n = count.of(i / channels, units);
        const PixelSum all = channel_of(film.words + 4 * i);
        const uint64_t cut = count.tail ? n % kGroupSamples : 0;
        resolve(
            cut ? estimate_cut(all, channel_of(count.tail + 4 * i), n - cut, cut, n / kGroupSamples)
                : estimate(all, n, units),
            film.scale, mean[i], error[i]);
        const uint32_t bits = bit_cast<uint32_t>(error[i] * film.scale);
        if (bits == 0) return;
        const uint32_t exponent = bits >> 23;
        if (exponent < 0xffu && bit_cast<uint32_t>(error[i]) >> 23 < 0xffu)
            add(sum.sum, to_fixed((bits & 0x7fffffu) | 0x800000u,
                                  static_cast<int>(exponent) - 150 + kSumScale));
        else
            ++sum.not_finite;
    }
};

// What a picture gets of one plane of a film of features.
struct PutFeature {
    enum Kind : uint32_t { kMeans, kShare, kIntegers } kind;
    bool point;         // add the origin
    uint32_t channels;  // at most 3
    float scale, unit;  // of the plane; by which means and errors are multiplied
    float nothing;      // the mean of no samples
    double origin[3];
    const uint64_t *words, *hits;  // of the first pixel
    uint64_t samples;
    float *mean, *error;

    VR_HD void operator()(uint64_t pixel) const {
        const uint64_t n = hits[2 * pixel];
        if (kind == kIntegers) {
            mean[pixel] = bit_cast<float>(static_cast<uint32_t>(words[2 * pixel]));
        } else if (kind == kShare) {
            const double share = static_cast<double>(n) / static_cast<double>(samples);
            const double others = static_cast<double>(samples > 2 ? samples - 1 : 1);
            mean[pixel] = static_cast<float>(share);
            error[pixel] = static_cast<float>(ieee_sqrt(share * (1.0 - share) / others));
        } else {
            for (uint32_t c = 0; c < channels; ++c) {
                const uint64_t i = pixel * channels + c;
                float m, e;
                resolve(estimate(channel_of(words + 4 * i), n, n), scale, m, e);
                m *= unit;
                if (point) m = static_cast<float>(static_cast<double>(m) + origin[c]);
                mean[i] = n ? m : nothing;
                error[i] = e * unit;
            }
        }
    }
};

struct Film::Impl {
    uint32_t width, height;
    int device;
    std::vector<PlaneInfo> planes;
    std::vector<float> scales;  // by plane
    std::vector<size_t> first;  // word by plane, and their number
    std::unique_ptr<FilmMemory> memory;
    uint64_t samples = 0, units = 0;

    FilmView view() const { return {memory->words(), width, height, scales[0]}; }
    // The plane of that name, to which samples of a scale are added; of integers: 0.
    PlaneView plane(const std::string& name, float scale);
    // A plane holds samples of one scale; the first to come set it.
    void check_scale(size_t plane, float scale) const;
    void match_scale(size_t plane, float scale) {
        check_scale(plane, scale);
        if (scale != 0) scales[plane] = scale;
    }
    // Throws where there is no number for `samples` with so many more.
    void with_more(uint64_t n) const;
};

struct Picture::Impl {
    uint32_t width, height, channels;
    bool integers;
    int device;
    double mean_error;
    std::unique_ptr<PictureMemory> memory;

    size_t size() const { return size_t{channels} * width * height; }
};

}  // namespace veriray
