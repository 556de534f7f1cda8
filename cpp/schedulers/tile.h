// Scheduler `fused` for the CPU: a tile of paths that stays in the cache, bounced together. Each
// bounce reads groups of lanes and writes the survivors side by side (compress-store), so that
// lanes stay full and all paths of the tile have one depth.
#pragma once

#include <memory>
#include <vector>

#include "film/lane_sums.h"
#include "schedulers/job.h"

namespace veriray {

// One worker's counts; rows appear as paths get deeper.
struct LedgerRows {
    std::vector<uint64_t> counts;
    uint64_t* row(uint32_t depth) {
        if (counts.size() < (depth + 1ull) * kLedgerColumns)
            counts.resize((depth + 1ull) * kLedgerColumns);
        return counts.data() + static_cast<size_t>(depth) * kLedgerColumns;
    }
};

inline constexpr uint32_t kTilePaths = 4096;

class Tile {
   public:
    // For runs of so many pixels and samples of each, or less of either.
    Tile(ColumnCount columns, uint32_t pixels, uint32_t samples) : sums_(pixels) {
        const size_t paths = size_t{pixels} * samples;
        floats_.resize(columns.floats, std::vector<float>(paths + Simd::kWidth));
        uints_.resize(columns.uints, std::vector<uint32_t>(paths + Simd::kWidth));
        for (auto& column : samples_) column.resize(2 * paths);  // rows in whole vectors
    }

    // Pixels [pixel, pixel + pixels), samples [sample, sample + samples) of the job.
    template <class Tracer>
    void run(const SceneView& scene, const Job& job, uint32_t pixel, uint32_t pixels,
             uint32_t sample, uint32_t samples, LedgerRows& ledger) {
        uint32_t live = pixels * samples;
        // Sums by lanes pay from the third sample on. Their pixels come in whole vectors.
        constexpr uint32_t kLanes = Simd::kWidth;
        const bool exact_in_lanes = kLanes > 1 && samples > 2 && !Tracer::kNegativeSamples;
        const bool by_units = job.squares != Squares::kOfSamples;
        const bool by_lanes = (exact_in_lanes || by_units) && pixels >= kLanes;
        stride_ = by_lanes ? (pixels + kLanes - 1) / kLanes * kLanes : pixels;
        first_pixel_ = pixel + job.settings.first, first_sample_ = job.sample_begin + sample;
        scale_ = job.film.scale * job.room();
        uint32_t x = pixel % job.width, y = pixel / job.width, s = 0;
        const auto begin = [&] {
            uint32_t xs[Simd::kWidth], ys[Simd::kWidth], ss[Simd::kWidth];
            for (uint32_t k = 0; k < Simd::kWidth; ++k) {
                xs[k] = x, ys[k] = y, ss[k] = first_sample_ + s;
                if (++s < samples) continue;
                s = 0;
                if (++x == job.width) x = 0, ++y;
            }
            return Tracer::begin(scene, job.settings, load(xs, U()), load(ys, U()), job.width,
                                 load(ss, U()));
        };
        for (uint32_t depth = 0; live; ++depth)
            live = bounce_all<Tracer>(scene, job, live, depth, ledger, begin);
        if (job.shared.numbers) return share<Tracer>(job, pixels, samples);
        if (by_units) {
            add_units<Tracer::kNegativeSamples>(job, pixel, pixels, samples);
            return;
        }
        if (exact_in_lanes && pixels == 1)
            add_samples_of_one(samples);
        else
            add_samples(pixels, samples, by_lanes);
        for (uint32_t k = 0; k < pixels; ++k) flush(job.film, pixel + k, sums_[k]);
    }

   private:
    using F = Simd::F;
    using U = Simd::U;
    using M = Simd::M;

    std::vector<std::vector<float>> floats_;
    std::vector<std::vector<uint32_t>> uints_;
    std::vector<float> samples_[3];  // [sample][pixel], times the film's scale
    std::vector<PixelSum> sums_;
    uint32_t first_pixel_ = 0, first_sample_ = 0, stride_ = 0;
    float scale_ = 0;  // of radiances, for the film's limit

    template <class Tracer>
    typename Tracer::State load_path(uint32_t i) const {
        typename Tracer::State p;  // fields that the variant lacks are not read
        Tracer::template each_field<kWholePath>(
            p, [&](uint32_t c, F& x) { x = load(floats_[c].data() + i, F()); },
            [&](uint32_t c, U& x) { x = load(uints_[c].data() + i, U()); });
        return p;
    }

    template <class Tracer>
    void store_path(uint32_t i, const typename Tracer::State& p, M m) {
        Tracer::template each_field<kWholePath>(
            p, [&](uint32_t c, F x) { compress_store(floats_[c].data() + i, x, m); },
            [&](uint32_t c, U x) { compress_store(uints_[c].data() + i, x, m); });
    }

    // Bounces `live` paths, which begin() gives at depth 0, keeps the survivors from slot 0 on,
    // returns their count.
    template <class Tracer, class Begin>
    uint32_t bounce_all(const SceneView& scene, const Job& job, uint32_t live, uint32_t depth,
                        LedgerRows& ledger, Begin begin) {
        uint64_t* row = ledger.row(depth);
        row[kLive] += live;
        uint32_t kept = 0;
        for (uint32_t i = 0; i < live; i += Simd::kWidth) {
            const M active = first_lanes(live - i, M());
            typename Tracer::State path = depth ? load_path<Tracer>(i) : begin();
            const Events<Simd> e = bounce<Tracer>(scene, job.settings, path, depth, active);
            const M ended = active & !e.alive;
            M bad = active & !active;
            if (any(ended)) bad = end_paths<Tracer>(scene, job, path, ended);
            row[kEscaped] += count(e.escaped & !bad);
            row[kEmitterEnd] += count(e.emitter_end & !bad);
            row[kAbsorbed] += count(e.absorbed & !bad);
            row[kRrKilled] += count(e.rr_killed & !bad);
            row[kDepthCut] += count(e.depth_cut & !bad);
            row[kInvalid] += count(bad);
            row[kShadowVisible] += count(e.visible);
            row[kShadowOccluded] += count(e.occluded);
            store_path<Tracer>(kept, path, e.alive);
            kept += count(e.alive);
        }
        return kept;
    }

    // Keeps the samples of ended lanes; returns the lanes that the film refuses.
    template <class Tracer>
    M end_paths(const SceneView& scene, const Job& job, const typename Tracer::State& path,
                M ended) {
        const M bad = ended & !film_accepts<Tracer::kNegativeSamples>(path.radiance, scale_);
        const Spectrum<F> sample =
            select(bad, Spectrum<F>::all(F(0.f)), path.radiance * F(job.film.scale));
        const U place =
            (path.sample + U(0u - first_sample_)) * U(stride_) + path.pixel + U(0u - first_pixel_);
        float x[3][Simd::kWidth];
        uint32_t at[Simd::kWidth];
        for (uint32_t c = 0; c < 3; ++c) store(x[c], sample[c]);
        store(at, place);
        for (uint32_t todo = bits(ended); todo; todo &= todo - 1) {
            const uint32_t k = static_cast<uint32_t>(__builtin_ctz(todo));
            for (uint32_t c = 0; c < 3; ++c) samples_[c][at[k]] = x[c][k];
        }
        if (any(bad)) log_faults(job, path, bits(bad));
        return bad;
    }

    template <class Path>
    static void log_faults(const Job& job, const Path& path, uint32_t bad) {
        float x[3][Simd::kWidth];
        uint32_t pixel[Simd::kWidth], sample[Simd::kWidth];
        for (uint32_t c = 0; c < 3; ++c) store(x[c], path.radiance[c]);
        store(pixel, path.pixel);
        store(sample, path.sample);
        for (; bad; bad &= bad - 1) {
            const uint32_t k = static_cast<uint32_t>(__builtin_ctz(bad));
            log_fault(job.faults, pixel[k], sample[k], {{x[0][k], x[1][k], x[2][k]}});
        }
    }

    // Hands the samples on, with where their paths went through the pixels.
    template <class Tracer>
    void share(const Job& job, uint32_t pixels, uint32_t samples) const {
        constexpr uint32_t kWidth = Simd::kWidth;
        for (uint32_t s = 0; s < samples; ++s)
            for (uint32_t first = 0; first < pixels; first += kWidth) {
                uint32_t pixel[kWidth];
                for (uint32_t k = 0; k < kWidth; ++k) pixel[k] = first_pixel_ + first + k;
                F at_x, at_y;
                Tracer::place_in_pixel(job.settings, load(pixel, U()), U(first_sample_ + s), at_x,
                                       at_y);
                float x[kWidth], y[kWidth];
                store(x, at_x), store(y, at_y);
                for (uint32_t k = 0; k < std::min(kWidth, pixels - first); ++k) {
                    const uint32_t at = s * stride_ + first + k;
                    job.share(pixel[k], first_sample_ + s, samples_[0][at], samples_[1][at],
                              samples_[2][at], x[k], y[k]);
                }
            }
    }

    // Adds units, or a part of one, to the film.
    template <bool kNegative>
    void add_units(const Job& job, uint32_t pixel, uint32_t pixels, uint32_t samples) {
        constexpr uint32_t kWidth = Simd::kWidth;
        const auto put = [](LaneSums<Simd>& sums, const float* x) {
            if constexpr (kNegative)
                sums.template add_signed<false>(load(x, F()));
            else
                sums.template add<false>(load(x, F()));
        };
        for (uint32_t first = 0; first < samples;) {
            const uint32_t from = first_sample_ + first;
            const uint32_t n =
                std::min(static_cast<uint32_t>(unit_end(from) - from), samples - first);
            for (uint32_t c = 0; c < 3; ++c) {
                const float* column = samples_[c].data() + first * stride_;
                LaneSums<Simd> sums;
                if (stride_ % kWidth == 0) {
                    for (uint32_t k = 0; k < pixels; k += kWidth) {
                        for (uint32_t s = 0; s < n; ++s) put(sums, column + s * stride_ + k);
                        sums.each_sum(std::min(pixels - k, kWidth), [&](uint32_t i, Fixed128 sum) {
                            add(sums_[k + i].sum[c], sum);
                        });
                    }
                    continue;
                }
                // Of one pixel each lane takes every kWidth-th sample.
                const uint32_t whole = pixels == 1 ? n - n % kWidth : 0;
                for (uint32_t s = 0; s < whole; s += kWidth) {
                    put(sums, column + s);
                    add(sums_[0].sum[c], sums.sum_of_lanes());
                }
                for (uint32_t s = whole; s < n; ++s)
                    for (uint32_t k = 0; k < pixels; ++k)
                        add_sample(sums_[k], static_cast<int>(c), column[s * stride_ + k], false);
            }
            for (uint32_t k = 0; k < pixels; ++k) job.add_unit(pixel + k, sums_[k], n);
            first += n;
        }
    }

    // Adds the samples to the only pixel; each lane sums every kWidth-th of them.
    void add_samples_of_one(uint32_t samples) {
        constexpr uint32_t kWidth = Simd::kWidth;
        const uint32_t whole = samples - samples % kWidth;
        for (uint32_t c = 0; c < 3; ++c) {
            const float* column = samples_[c].data();
            for (uint32_t first = 0; first < whole; first += kLaneSamples * kWidth) {
                LaneSums<Simd> sums;
                const uint32_t last = std::min(whole, first + kLaneSamples * kWidth);
                for (uint32_t s = first; s < last; s += kWidth) sums.add(load(column + s, F()));
                sums.each(kWidth, [&](uint32_t, Fixed128 sum, Fixed128 square) {
                    add(sums_[0].sum[c], sum);
                    add(sums_[0].square[c], square);
                });
            }
            for (uint32_t s = whole; s < samples; ++s)
                add_sample(sums_[0], static_cast<int>(c), column[s]);
        }
    }

    // Adds the samples to their pixels.
    void add_samples(uint32_t pixels, uint32_t samples, bool by_lanes) {
        for (uint32_t c = 0; c < 3; ++c)
            for (uint32_t first = 0; first < samples; first += kLaneSamples) {
                const float* column = samples_[c].data() + first * stride_;
                const uint32_t count = std::min(samples - first, kLaneSamples);
                if (by_lanes)
                    for (uint32_t k = 0; k < pixels; k += Simd::kWidth) {
                        LaneSums<Simd> sums;
                        for (uint32_t s = 0; s < count; ++s)
                            sums.add(load(column + s * stride_ + k, F()));
                        sums.flush(&sums_[k], c, std::min(pixels - k, Simd::kWidth));
                    }
                else
                    for (uint32_t s = 0; s < count; ++s)
                        for (uint32_t k = 0; k < pixels; ++k)
                            add_sample(sums_[k], static_cast<int>(c), column[s * stride_ + k]);
            }
    }
};

}  // namespace veriray
