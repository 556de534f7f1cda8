// The CPU back end: memory, threads and errors; no radiance is computed here. Compiled once for
// each instruction set.
#include <thrust/version.h>
#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <fstream>
#include <thread>

#include "backends/instances.h"
#include "backends/waves_cpu.h"
#include "scene/thread_pool.h"
#include "scene/tree_layout.h"

namespace veriray {

struct Film::Impl {
    FilmView view;
    uint64_t samples = 0;
    std::vector<uint64_t> words;
};

struct Scene::Impl {
    HostScene host;
    std::vector<WideNode<kCpuWidth>> nodes;
    std::vector<RecordBlock> blocks;
    std::vector<Simd::Uniform> quads, shorts;
    std::vector<QuadRun> runs;
    TreeInfo info;

    Impl(const SceneInput& in, TreeBuilder builder, const BuildPoll& poll) : host(in) {
        quads.assign(host.view.quads, host.view.quads + host.view.quad_count * kQuadFloats);
        for (uint32_t i = 0; i < host.view.quad_count; ++i) {
            float record[kShortFloats] = {};
            const uint32_t way = write_short(host.view.quads + kQuadFloats * i, record);
            shorts.insert(shorts.end(), record, record + kShortFloats);
            if (runs.empty() || runs.back().way != way) runs.push_back({way, i});
            ++runs.back().end;
        }
        host.view.uniform_quads = quads.data();
        host.view.uniform_shorts = shorts.data();
        host.view.runs = runs.data();
        host.view.run_count = static_cast<uint32_t>(runs.size());
        if (!(host.view.features & kBvh)) return;
        auto tree = build_tree<kCpuWidth>(host.tree_input(), builder, kSimdWalk, kAllThreads, poll);
        blocks = pack_blocks(tree.nodes, tree.order, host.records);
        info = tree_info(
            builder, tree,
            tree.nodes.size() * sizeof(WideNode<kCpuWidth>) + blocks.size() * sizeof(RecordBlock));
        nodes = std::move(tree.nodes);
        host.view.bvh = {nodes.data(), blocks.data(), host.slab_slack};
    }
};

Film::Film(uint32_t width, uint32_t height, int) : impl(std::make_unique<Impl>()) {
    check_film_size(width, height);
    const size_t words = static_cast<size_t>(width) * height * kFilmWords;
    try {
        impl->words.resize(words);
    } catch (const std::bad_alloc&) {
        throw OutOfMemoryError("film: needs " + std::to_string(words * 8) + " bytes");
    }
    impl->view = {impl->words.data(), width, height, 0.f};
}
Film::~Film() = default;
uint32_t Film::width() const { return impl->view.width; }
uint32_t Film::height() const { return impl->view.height; }
uint64_t Film::samples() const { return impl->samples; }
size_t Film::memory() const { return impl->words.size() * sizeof(uint64_t); }
void Film::clear() {
    std::fill(impl->words.begin(), impl->words.end(), 0);
    impl->samples = 0;
    impl->view.scale = 0;
}

void Film::add(const Film& other) {
    if (other.width() != width() || other.height() != height())
        throw std::invalid_argument("films of different sizes cannot be added");
    match_scale(impl->view.scale, other.impl->view.scale);
    for (size_t i = 0; i < impl->words.size(); i += 2) {
        Fixed128 a{impl->words[i], impl->words[i + 1]};
        veriray::add(a, {other.impl->words[i], other.impl->words[i + 1]});
        impl->words[i] = a.lo;
        impl->words[i + 1] = a.hi;
    }
    impl->samples += other.impl->samples;
}

void Film::resolve(float* mean, float* standard_error, const uint64_t* counts) const {
    const float scale = impl->view.scale ? impl->view.scale : 1.f;
    for (size_t i = 0; i < impl->words.size() / 4; ++i)
        veriray::resolve(&impl->words[i / 3 * kFilmWords], static_cast<uint32_t>(i % 3), scale,
                         counts ? counts[i / 3] : impl->samples, mean[i], standard_error[i]);
}

void Film::sums(double* out) const {
    const float scale = impl->view.scale ? impl->view.scale : 1.f;
    for (size_t i = 0; i < impl->words.size() / 4; ++i)
        out[i] = film_sum(&impl->words[i / 3 * kFilmWords], static_cast<uint32_t>(i % 3), scale);
}

void Film::words(uint64_t* out) const { std::copy(impl->words.begin(), impl->words.end(), out); }

Scene::Scene(const SceneInput& in, int, const std::string& builder, const BuildPoll& poll)
    : impl(std::make_unique<Impl>(in, find_builder(builder), poll)) {}
Scene::~Scene() = default;
const HostScene& Scene::host() const { return impl->host; }
TreeInfo Scene::tree() const { return impl->info; }

namespace {

bool render_tiles(const SceneView& view, const Job& job, const RenderSettings& s,
                  std::vector<LedgerRows>& ledgers, RenderStats& stats, const Poll& poll) {
    const uint32_t tile = s.batch ? std::min(s.batch, kTilePaths) : kTilePaths;
    const uint64_t pixels = job.pixels();
    // Listed pixels come in runs side by side.
    std::vector<std::pair<uint32_t, uint32_t>> runs;
    // A tile holds as many samples of a pixel as it can once its pixels run out, 64 before.
    const uint32_t samples = static_cast<uint32_t>(std::min<uint64_t>(
        {job.samples, tile, std::max<uint64_t>(64, tile / std::min<uint64_t>(pixels, tile))}));
    const uint32_t width = std::max(1u, tile / samples);
    for (uint32_t pixel : s.pixels) {
        const bool next = !runs.empty() && runs.back().first + runs.back().second == pixel &&
                          runs.back().second < width;
        if (next)
            ++runs.back().second;
        else
            runs.push_back({pixel, 1});
    }
    const uint64_t pixel_runs = job.listed ? runs.size() : (pixels + width - 1) / width;
    const uint64_t sample_runs = (job.samples + samples - 1) / samples;
    std::vector<std::unique_ptr<Tile>> tiles(stats.threads);
    const CpuVariant& variant = chosen_variant(view, s);
    ++stats.launches;
    return parallel(
        stats.threads, pixel_runs * sample_runs, poll, [&](uint32_t worker, uint64_t unit) {
            if (!tiles[worker]) tiles[worker] = std::make_unique<Tile>(variant.path);
            const uint64_t run = unit % pixel_runs;
            const uint32_t k = static_cast<uint32_t>(unit / pixel_runs) * samples;
            const auto [first, count] =
                job.listed
                    ? runs[run]
                    : std::pair(
                          static_cast<uint32_t>(run * width),
                          static_cast<uint32_t>(std::min<uint64_t>(width, pixels - run * width)));
            variant.tile(*tiles[worker], view, job, first, count, k,
                         std::min(samples, job.samples - k), ledgers[worker]);
        });
}

}  // namespace

RenderStats render(const Scene& scene, Film& film, const RenderSettings& s, const Poll& poll) {
    const HostScene& host = scene.host();
    check_settings(s, host, film);
    match_scale(film.impl->view.scale, host.view.emission_scale);
    RenderStats stats;
    const uint32_t cores = std::max(1u, std::thread::hardware_concurrency());
    stats.threads = s.threads ? s.threads : cores;
    if (stats.threads > 4096)
        throw std::invalid_argument("threads = " + std::to_string(s.threads) +
                                    "; allowed: 0 (all) to 4096");
    stats.device = "cpu";
    stats.features = kVariants[choose_variant(host.view, s)];
    std::vector<LedgerRows> ledgers(stats.threads);
    const auto start = std::chrono::steady_clock::now();
    bool complete = true;
    const uint64_t pixels = pixel_count(s, film);
    for_sample_ranges(s, pixels, poll,
                      [&](const PathSettings& settings, uint32_t begin, uint32_t samples,
                          uint32_t upper, const Poll& part) {
                          if (!complete) return;
                          FaultLog faults{};
                          const Job job{settings,
                                        film.impl->view,
                                        &faults,
                                        begin,
                                        samples,
                                        s.pixels.empty() ? nullptr : s.pixels.data(),
                                        static_cast<uint32_t>(s.pixels.size())};
                          complete = by_method(find_scheduler(s.scheduler)->method, render_tiles,
                                               render_thrust, render_wavefront)(
                              host.view, job, s, ledgers, stats, part);
                          add_faults(stats, faults, film.width(), upper);
                      });
    if (!complete) throw std::runtime_error("the render was stopped; its film is incomplete");
    stats.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    for (LedgerRows& rows : ledgers) {
        if (stats.ledger.size() < rows.counts.size()) stats.ledger.resize(rows.counts.size());
        for (size_t i = 0; i < rows.counts.size(); ++i) stats.ledger[i] += rows.counts[i];
    }
    const uint64_t samples = s.sample_end - s.sample_begin;
    if (s.pixels.empty()) film.impl->samples += samples;
    complete_ledger(stats.ledger, samples * pixels);
    return stats;
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
        one, 1, {},
        [&](const PathSettings& settings, uint32_t low, uint32_t, uint32_t, const Poll&) {
            cpu_variant(kIntegrator, kVariantCount - 1).trace(host, settings, x, y, low, out);
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
