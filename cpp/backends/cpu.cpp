// The CPU back end: memory, threads and errors; no radiance is computed here. Compiled once for
// each instruction set.
#include <thrust/version.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <mutex>
#include <thread>

#include "backends/film_memory.h"
#include "backends/instances.h"
#include "backends/render.h"
#include "backends/waves_cpu.h"
#include "scene/thread_pool.h"
#include "scene/tree_layout.h"

namespace veriray {

namespace {

// What this back end makes of a scene's primitives.
struct CpuTables {
    std::vector<WideNode<kCpuWidth>> nodes;
    Large<RecordBlock> blocks;
    std::vector<Simd::Uniform> quads, shorts;
    std::vector<QuadRun> runs;
    TreeInfo info;

    CpuTables(const HostScene& host, TreeBuilder builder, const BuildPoll& poll) {
        quads.assign(host.view.quads, host.view.quads + host.view.quad_count * kQuadFloats);
        for (uint32_t i = 0; i < host.view.quad_count; ++i) {
            float record[kShortFloats] = {};
            const uint32_t way = write_short(host.view.quads + kQuadFloats * i, record);
            shorts.insert(shorts.end(), record, record + kShortFloats);
            if (runs.empty() || runs.back().way != way) runs.push_back({way, i});
            ++runs.back().end;
        }
        if (!(host.view.features & kBvh)) return;
        auto tree = build_tree<kCpuWidth>(host.tree_input(), builder, kSimdWalk<kCpuLeaf>,
                                          kAllThreads, poll);
        blocks = pack_blocks(tree.nodes, tree.order, host.records.data());
        info = tree_info(
            builder, tree,
            tree.nodes.size() * sizeof(WideNode<kCpuWidth>) + blocks.size() * sizeof(RecordBlock));
        nodes = std::move(tree.nodes);
    }
};

}  // namespace

struct Scene::Impl {
    HostScene host;
    std::shared_ptr<const CpuTables> tables;

    Impl(const SceneInput& in, TreeBuilder builder, const BuildPoll& poll) : host(in) {
        put_tables(builder, poll);
    }
    void put_tables(TreeBuilder builder, const BuildPoll& poll) {
        tables = std::make_shared<CpuTables>(host, builder, poll);
        SceneView& view = host.view;
        view.uniform_quads = tables->quads.data();
        view.uniform_shorts = tables->shorts.data();
        view.runs = tables->runs.data();
        view.run_count = static_cast<uint32_t>(tables->runs.size());
        if (view.features & kBvh)
            view.bvh = {tables->nodes.data(), tables->blocks.data(), host.slab_slack,
                        tables->info.memory > kCachedTree,
                        host.view.sphere_count + host.view.disk_count > 0};
    }
};

namespace {

// The system clears large memory page by page where it is first used, so the threads of a render
// share that work.
class HostPicture final : public PictureMemory {
   public:
    explicit HostPicture(size_t n) : numbers_(n) {}
    float* numbers() override { return numbers_.data(); }
    void read(size_t first, size_t n, float* out) const override {
        std::copy_n(numbers_.data() + first, n, out);
    }

   private:
    Large<float> numbers_;
};

class HostFilm final : public FilmMemory {
   public:
    explicit HostFilm(size_t words) : words_(words) {}
    uint64_t* words() override { return words_.data(); }
    void clear() override { std::fill_n(words_.data(), words_.size(), 0); }
    void read(size_t first, size_t n, uint64_t* out) const override {
        std::copy_n(words_.data() + first, n, out);
    }
    void add(const FilmMemory& other) override {
        add(0, words_.size(), static_cast<const HostFilm&>(other).words_.data());
    }
    void add(size_t first, size_t n, const uint64_t* from) override {
        const AddNumbers add_one{words_.data() + first, from};
        for (size_t i = 0; i < n / 2; ++i) add_one(i);
    }
    void end_unit(const FilmView& film, uint32_t n) override {
        const EndUnit end_one{film, n};
        const size_t size = size_t{film.width} * film.height;
        in_chunks(3 * size < kFew ? 1 : kAllThreads, size, [&](size_t first, size_t last) {
            for (size_t i = first; i < last; ++i) end_one(i);
        });
    }
    std::unique_ptr<PictureMemory> resolve(const FilmView& film, uint32_t channels,
                                           const SampleCount& count, uint32_t threads,
                                           ErrorSum& sum) const override {
        const uint64_t size = uint64_t{channels} * film.width * film.height;
        auto out = picture_memory(2 * size, 0);
        const ResolveChannels resolve_one{film, channels, count, out->numbers(),
                                          out->numbers() + size};
        std::mutex mutex;
        in_chunks(size < kFew ? 1 : threads, size, [&](size_t first, size_t last) {
            ErrorSum part{};
            for (size_t i = first; i < last; ++i) resolve_one(i, part);
            const std::lock_guard lock(mutex);
            veriray::add(sum.sum, part.sum);
            sum.not_finite += part.not_finite;
        });
        return out;
    }
    void put(const std::vector<PutFeature>& parts, uint64_t pixels,
             uint32_t threads) const override {
        uint64_t size = 0;
        for (const PutFeature& part : parts) size += pixels * part.channels;
        in_chunks(size < kFew ? 1 : threads, pixels, [&](size_t first, size_t last) {
            for (const PutFeature& part : parts)
                for (size_t i = first; i < last; ++i) part(i);
        });
    }

   private:
    static constexpr uint64_t kFew = 1 << 17;  // numbers, sooner made than threads start

    Large<uint64_t> words_;
};

}  // namespace

std::unique_ptr<PictureMemory> picture_memory(size_t n, int) {
    try {
        return std::make_unique<HostPicture>(n);
    } catch (const std::bad_alloc&) {
        throw OutOfMemoryError("picture: needs " + std::to_string(n * sizeof(float)) + " bytes");
    }
}
std::unique_ptr<FilmMemory> film_memory(size_t words, int) {
    try {
        return std::make_unique<HostFilm>(words);
    } catch (const std::bad_alloc&) {
        throw OutOfMemoryError("film: needs " + std::to_string(words * 8) + " bytes");
    }
}

Scene::Scene(const SceneInput& in, std::shared_ptr<const void> keeps, int,
             const std::string& builder, const BuildPoll& poll)
    : impl(with_team([&] { return std::make_unique<Impl>(in, find_builder(builder), poll); })),
      input(in),
      owner(std::move(keeps)) {}
Scene::Scene(std::unique_ptr<Impl> made, const SceneInput& in, std::shared_ptr<const void> keeps)
    : impl(std::move(made)), input(in), owner(std::move(keeps)) {}
Scene::~Scene() = default;
std::unique_ptr<Scene> Scene::changed(const SceneInput& in, std::shared_ptr<const void> keeps,
                                      bool rough) const {
    auto made = std::make_unique<Impl>(*impl);
    if (!made->host.change(input, in, rough)) return nullptr;
    return std::unique_ptr<Scene>(new Scene(std::move(made), in, std::move(keeps)));
}
std::unique_ptr<Scene> Scene::rebuilt(const std::string& tree_builder,
                                      const BuildPoll& poll) const {
    auto made = std::make_unique<Impl>(*impl);
    with_team([&] { made->put_tables(find_builder(tree_builder), poll); });
    return std::unique_ptr<Scene>(new Scene(std::move(made), input, owner));
}
const void* Scene::family() const { return impl->tables.get(); }
const HostScene& Scene::host() const { return impl->host; }
TreeInfo Scene::tree() const { return impl->tables->info; }

namespace {

bool render_tiles(const SceneView& view, const Job& job, const RenderSettings& s,
                  std::vector<LedgerRows>& ledgers, RenderStats& stats, const Poll& poll) {
    const bool by_units = job.squares == Squares::kOfUnits;
    const uint32_t least = by_units ? kGroupSamples : 1;
    const uint32_t tile = s.batch ? std::clamp(s.batch, least, kTilePaths) : kTilePaths;
    const uint64_t pixels = job.pixels();
    // Listed pixels come in runs side by side.
    std::vector<std::pair<uint32_t, uint32_t>> runs;
    // A tile holds as many samples of a pixel as it can once its pixels run out, 64 before; whole
    // units.
    uint32_t samples = static_cast<uint32_t>(std::min<uint64_t>(
        {job.samples, tile, std::max<uint64_t>(64, tile / std::min<uint64_t>(pixels, tile))}));
    const uint32_t width = std::max(1u, tile / samples);
    uint32_t ahead = 0;  // samples that the first run lacks, so that the others begin with a unit
    if (by_units && samples < job.samples) {
        samples -= samples % kGroupSamples;
        ahead = job.sample_begin % samples;
    }
    for (uint32_t i = 0; i < job.listed_count; ++i) {
        const uint32_t pixel = job.listed[i];
        const bool next = !runs.empty() && runs.back().first + runs.back().second == pixel &&
                          runs.back().second < width;
        if (next)
            ++runs.back().second;
        else
            runs.push_back({pixel, 1});
    }
    const uint64_t pixel_runs = job.listed ? runs.size() : (pixels + width - 1) / width;
    const uint64_t sample_runs = (uint64_t{ahead} + job.samples + samples - 1) / samples;
    std::vector<std::unique_ptr<Tile>> tiles(stats.threads);
    const CpuVariant& variant = cpu_variant(kIntegrator, choose_variant(view, s));
    ++stats.launches;
    return parallel(
        stats.threads, pixel_runs * sample_runs, poll, [&](uint32_t worker, uint64_t unit) {
            if (!tiles[worker])
                tiles[worker] = std::make_unique<Tile>(
                    variant.path, static_cast<uint32_t>(std::min<uint64_t>(width, pixels)),
                    samples);
            const uint64_t run = unit % pixel_runs;
            const uint64_t end = (unit / pixel_runs + 1) * samples - ahead;
            const uint32_t k = end > samples ? static_cast<uint32_t>(end - samples) : 0;
            const auto [first, count] =
                job.listed
                    ? runs[run]
                    : std::pair(
                          static_cast<uint32_t>(run * width),
                          static_cast<uint32_t>(std::min<uint64_t>(width, pixels - run * width)));
            variant.tile(*tiles[worker], view, job, first, count, k,
                         static_cast<uint32_t>(std::min<uint64_t>(end, job.samples)) - k,
                         ledgers[worker]);
        });
}

class CpuRunner final : public Runner {
   public:
    CpuRunner(const SceneView& scene, const RenderSettings& s, RenderStats& stats)
        : scene_(sampled_view(scene)), s_(s), stats_(stats) {
        stats.threads = s.threads ? s.threads : std::max(1u, std::thread::hardware_concurrency());
        if (stats.threads > 4096)
            throw std::invalid_argument("threads = " + std::to_string(s.threads) +
                                        "; allowed: 0 (all) to 4096");
        stats.device = "cpu";
        ledgers_.resize(stats.threads);
    }
    // As the caches hold, but 4 where these take 256 MiB at most: each job adds to all of the film.
    uint64_t shared_at_once(uint64_t numbers) const override {
        const uint64_t cached = (1ull << 22) * std::min(stats_.threads, 32u);
        return std::max(cached / numbers, std::min<uint64_t>(4, (1ull << 26) / numbers));
    }
    float* share(uint64_t numbers) override {
        try {
            shared_.resize(numbers + Simd::kWidth);  // lanes pass the end of the last row
        } catch (const std::bad_alloc&) {
            throw OutOfMemoryError("shared samples: needs " +
                                   std::to_string(numbers * sizeof(float)) + " bytes");
        }
        return shared_.data();
    }
    bool run(const Job& job, bool counted, const Poll& poll) override {
        RenderStats no_stats = stats_;
        std::vector<LedgerRows> no_ledgers(counted ? 0 : stats_.threads);
        return by_method(find_scheduler(s_.scheduler)->method, render_tiles, render_thrust,
                         render_wavefront)(scene_, job, s_, counted ? ledgers_ : no_ledgers,
                                           counted ? stats_ : no_stats, poll);
    }
    uint64_t* units(uint64_t pixels) override {
        if (units_.empty()) try {
                units_.resize(pixels * kUnitWords);
            } catch (const std::bad_alloc&) {
                throw OutOfMemoryError("sums of samples: needs " +
                                       std::to_string(pixels * kUnitWords * sizeof(uint64_t)) +
                                       " bytes");
            }
        return units_.data();
    }
    bool adds_units() const override {
        return find_scheduler(s_.scheduler)->method == Method::kFused;
    }
    bool add_shared(const Job& job, const Poll& poll) override;
    void end_units(const Job& job, uint32_t n) override {
        constexpr uint64_t kFew = 1 << 16;
        in_chunks(job.pixels() < kFew ? 1 : stats_.threads, job.pixels(),
                  [&](size_t first, size_t last) {
                      for (size_t i = first; i < last; ++i)
                          job.end_unit_of(job.pixel(static_cast<uint32_t>(i)), n);
                  });
    }
    std::vector<uint64_t> ledger(uint64_t first) override {
        std::vector<uint64_t> sum;
        if (first) return sum;
        for (const LedgerRows& rows : ledgers_) {
            if (sum.size() < rows.counts.size()) sum.resize(rows.counts.size());
            for (size_t i = 0; i < rows.counts.size(); ++i) sum[i] += rows.counts[i];
        }
        return sum;
    }

   private:
    const SceneView scene_;
    const RenderSettings& s_;
    RenderStats& stats_;
    std::vector<LedgerRows> ledgers_;
    Large<float> shared_;
    Large<uint64_t> units_;
};

bool CpuRunner::add_shared(const Job& job, const Poll& poll) {
    const FilterView& filter = scene_.filter;
    constexpr uint64_t kRows = 4096;
    const uint64_t rows = job.shared.rows();
    const auto weigh = [&](uint32_t, uint64_t unit) {
        if (!job.shared.reach) return;
        uint64_t row = unit * kRows;
        const uint64_t end = std::min(rows, row + kRows);
        for (; row + Simd::kWidth <= end; row += Simd::kWidth)
            weigh_sample<Simd>(filter, job.shared, row);
        for (; row < end; ++row) weigh_sample<Scalar>(filter, job.shared, row);
    };
    // `count` pixels from (x, y) on, of a row.
    const auto add = [&]<class L>(uint32_t x, uint32_t y, uint32_t count) {
        PixelSum pixels[L::kWidth] = {};
        const auto at = [&](uint32_t i) { return y * job.film.width + x + i; };
        if (job.squares == Squares::kOfSamples) {
            for (uint32_t first = 0; first < job.samples; first += kLaneSamples) {
                LaneSums<L> sums[3];
                for (uint32_t k = first; k < std::min(first + kLaneSamples, job.samples); ++k) {
                    const auto sample = shared_sample<L>(filter, job.shared, x, y, k);
                    for (uint32_t c = 0; c < 3; ++c) sums[c].add_signed(sample[c]);
                }
                for (uint32_t c = 0; c < 3; ++c) sums[c].flush(pixels, c, count);
            }
            for (uint32_t i = 0; i < count; ++i) flush(job.film, at(i), pixels[i]);
            return;
        }
        for (uint32_t unit = 0; unit < job.units(); ++unit) {
            const SampleRun run = job.samples_of_unit(unit);
            LaneSums<L> sums[3];
            for (uint32_t k = run.begin; k < run.end; ++k) {
                const auto sample = shared_sample<L>(filter, job.shared, x, y, k);
                for (uint32_t c = 0; c < 3; ++c) sums[c].template add_signed<false>(sample[c]);
            }
            for (uint32_t c = 0; c < 3; ++c)
                sums[c].each_sum(count, [&](uint32_t i, Fixed128 sum) { pixels[i].sum[c] = sum; });
            for (uint32_t i = 0; i < count; ++i)
                job.add_unit(at(i), pixels[i], run.end - run.begin);
        }
    };
    // Blocks that go down the film, so that rows of samples stay in the cache until all have used
    // them.
    constexpr uint32_t kWide = 64, kHigh = 32;
    const uint32_t width = job.film.width, height = job.film.height;
    const uint32_t across = (width + kWide - 1) / kWide, down = (height + kHigh - 1) / kHigh;
    const auto add_block = [&](uint32_t, uint64_t unit) {
        const uint32_t left = static_cast<uint32_t>(unit % across) * kWide,
                       top = static_cast<uint32_t>(unit / across) * kHigh;
        for (uint32_t y = top; y < std::min(height, top + kHigh); ++y)
            for (uint32_t x = left; x < std::min(width, left + kWide); x += Simd::kWidth)
                add.template operator()<Simd>(x, y, std::min(Simd::kWidth, width - x));
    };
    const auto add_listed = [&](uint32_t, uint64_t unit) {
        const uint32_t pixel = job.listed[unit];
        add.template operator()<Scalar>(pixel % width, pixel / width, 1);
    };
    return parallel(stats_.threads, (rows + kRows - 1) / kRows, poll, weigh) &&
           (job.listed ? parallel(stats_.threads, job.listed_count, poll, add_listed)
                       : parallel(stats_.threads, uint64_t{across} * down, poll, add_block));
}

}  // namespace

std::unique_ptr<Runner> make_runner(const Scene& scene, const Film&, const RenderSettings& s,
                                    RenderStats& stats) {
    return std::make_unique<CpuRunner>(scene.host().view, s, stats);
}

std::vector<PathVertex> trace_path(const Scene& scene, const RenderSettings& s, uint32_t x,
                                   uint32_t y, uint64_t sample) {
    const HostScene& host = scene.host();
    if (x >= host.width || y >= host.height)
        throw std::invalid_argument("pixel (" + std::to_string(x) + ", " + std::to_string(y) +
                                    ") is outside the film of " + std::to_string(host.width) +
                                    " x " + std::to_string(host.height));
    RenderSettings one = s;
    one.sample_begin = sample;
    one.sample_end = sample + 1;
    std::vector<PathVertex> out;
    for_sample_ranges(
        one, 1, 1, {},
        [&](const PathSettings& settings, uint32_t low, SamplePart, uint32_t, const Poll&) {
            cpu_waves(kIntegrator, kVariantCount - 1).trace(host, settings, x, y, low, out);
        });
    return out;
}

BuildInfo build_info() {
#if defined(__AVX512F__)
    const char* isa = "avx512";
#elif defined(__AVX2__)
    const char* isa = "avx2";
#else
    const char* isa = "portable";
#endif
#if defined(__clang__)
    const std::string compiler = "Clang " __clang_version__;
#else
    const std::string compiler = "GCC " __VERSION__;
#endif
    const std::string thrust = std::to_string(THRUST_MAJOR_VERSION) + "." +
                               std::to_string(THRUST_MINOR_VERSION) + "." +
                               std::to_string(THRUST_SUBMINOR_VERSION);
    return {"cpu", isa, compiler, thrust, "", "", Simd::kWidth};
}

std::string why_unusable() {
#if defined(__x86_64__)
    __builtin_cpu_init();
    const char* lacks = nullptr;
#if defined(__AVX512F__)
    if (!__builtin_cpu_supports("avx512f")) lacks = "AVX-512F";
    if (!__builtin_cpu_supports("avx512dq")) lacks = "AVX-512DQ";
    if (!__builtin_cpu_supports("avx512bw")) lacks = "AVX-512BW";
    if (!__builtin_cpu_supports("avx512cd")) lacks = "AVX-512CD";
    if (!__builtin_cpu_supports("avx512vl")) lacks = "AVX-512VL";
#endif
#if defined(__AVX2__)
    if (!__builtin_cpu_supports("avx2")) lacks = "AVX2";
    if (!__builtin_cpu_supports("fma")) lacks = "FMA";
    if (!__builtin_cpu_supports("bmi2")) lacks = "BMI2";
#endif
    if (lacks) return std::string("this processor lacks ") + lacks;
#endif
    return "";
}

std::vector<DeviceInfo> devices() {
    DeviceInfo d{};
    std::ifstream info("/proc/cpuinfo");
    for (std::string line; std::getline(info, line);)
        if (line.rfind("model name", 0) == 0) {
            d.name = line.substr(std::min(line.size(), line.find(':') + 2));
            break;
        }
    const uint64_t page = static_cast<uint64_t>(sysconf(_SC_PAGESIZE));
    d.memory_total = page * static_cast<uint64_t>(sysconf(_SC_PHYS_PAGES));
    d.memory_free = page * static_cast<uint64_t>(sysconf(_SC_AVPHYS_PAGES));
    d.multiprocessors = static_cast<int>(std::thread::hardware_concurrency());
    return {d};
}

}  // namespace veriray
