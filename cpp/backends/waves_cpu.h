// The schedulers that keep their paths in memory, `thrust` and `wavefront`, on CPU threads.
#pragma once

#include <thrust/execution_policy.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <vector>

#include "backends/cpu_variant.h"
#include "scene/thread_pool.h"
#include "schedulers/thrust.h"

namespace veriray {
namespace {

template <class T>
std::vector<T> pool_memory(size_t n, const char* what) {
    try {
        return std::vector<T>(n);
    } catch (const std::bad_alloc&) {
        throw OutOfMemoryError(std::string(what) + ": needs " + std::to_string(n * sizeof(T)) +
                               " bytes");
    }
}

const CpuWaves& chosen_waves(const SceneView& view, const RenderSettings& s, RenderStats& stats) {
    const uint32_t index = choose_variant(view, s, kFewVariants);
    stats.features = kVariants[index];
    return cpu_waves(kIntegrator, index);
}

// Executor of the `thrust` scheduler on Thrust's host system: blocks are shared out to threads.
struct HostExec {
    const CpuWaves& variant;
    const SceneView& scene;
    const Job& job;
    const PathPool& pool;
    std::vector<LedgerRows>& ledgers;
    uint32_t threads;
    const Poll& on_poll;
    uint64_t* launches;
    double share = 0;
    // Sooner moved on, on this thread, than another one starts; run_thrust polls between launches.
    static constexpr uint64_t kFewBlocks = 16;
    bool stopped = false;
    std::chrono::steady_clock::time_point polled = std::chrono::steady_clock::now();

    template <class Body>
    void launch(uint32_t n, Body body) {
        ++*launches;
        const uint64_t blocks = (n + kThrustBlock - 1) / kThrustBlock;
        if (blocks == 1 || (threads == 1 && blocks <= kFewBlocks)) {
            for (uint32_t first = 0; first < n; first += kThrustBlock)
                body(0u, first, std::min(n, first + kThrustBlock));
            return;
        }
        const Poll each = [&](double) { return poll_now(); };
        stopped |= !parallel(threads, blocks, each, [&](uint32_t worker, uint64_t block) {
            const uint32_t first = static_cast<uint32_t>(block) * kThrustBlock;
            body(worker, first, std::min(n, first + kThrustBlock));
        });
    }
    void begin(const PathIndices& indices, uint64_t first, uint32_t n) {
        launch(n, [&](uint32_t, uint32_t begin, uint32_t end) {
            variant.thrust_begin(scene, job, pool.paths, indices.now, first, begin, end);
        });
    }
    void bounce(const PathIndices& indices, uint32_t depth, uint32_t n) {
        *indices.appended = 0;
        for (LedgerRows& rows : ledgers) rows.row(depth);
        launch(n, [&](uint32_t worker, uint32_t begin, uint32_t end) {
            variant.thrust_bounce(scene, job, pool, indices, depth, begin, end,
                                  ledgers[worker].row(depth));
        });
    }
    auto policy() const { return thrust::host; }
    static uint32_t appended(const uint32_t* counter) { return *counter; }
    static double clock() {
        return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch())
            .count();
    }
    bool poll_now() {
        polled = std::chrono::steady_clock::now();
        return !on_poll || on_poll(share);
    }
    bool poll(double done) {
        share = done;
        if (std::chrono::steady_clock::now() - polled > kPollPause) stopped |= !poll_now();
        return !stopped;
    }
};

bool render_thrust(const SceneView& view, const Job& job, const RenderSettings& s,
                   std::vector<LedgerRows>& ledgers, RenderStats& stats, const Poll& poll) {
    const CpuWaves& variant = chosen_waves(view, s, stats);
    const Compaction compaction = find_scheduler(s.scheduler)->compaction;
    const size_t slots = pool_slots(s.batch, job);
    auto floats = pool_memory<float>(variant.path.floats * slots, "path pool");
    auto uints = pool_memory<uint32_t>(variant.path.uints * slots, "path pool");
    auto index = pool_memory<int32_t>(index_columns(compaction) * slots, "path pool");
    uint32_t appended = 0;
    const PathPool pool = make_pool(compaction, static_cast<uint32_t>(slots), floats.data(),
                                    uints.data(), index.data(), &appended);
    HostExec exec{variant, view, job, pool, ledgers, stats.threads, poll, &stats.launches};
    run_thrust(exec, job.paths(), pool,
               {stats.blocks, stats.depth_seconds, stats.compaction_seconds});
    return !exec.stopped;
}

// Each thread moves on a tile at a time, through all stages, which stays in its cache.
bool render_wavefront(const SceneView& view, const Job& job, const RenderSettings& s,
                      std::vector<LedgerRows>& ledgers, RenderStats& stats, const Poll& poll) {
    const CpuWaves& variant = chosen_waves(view, s, stats);
    const uint32_t kinds = find_scheduler(s.scheduler)->sorted ? kHitKinds : 1;
    const uint64_t most = std::min<uint64_t>(stats.threads * kTileSlots, job.paths());
    const uint32_t capacity =
        static_cast<uint32_t>(s.batch ? std::min<uint64_t>(s.batch, most) : most);
    const ColumnCount columns = wave_columns(variant.path, variant.request, kinds);
    auto floats = pool_memory<float>(static_cast<size_t>(columns.floats) * capacity, "wave");
    auto uints = pool_memory<uint32_t>(static_cast<size_t>(columns.uints) * capacity, "wave");
    WaveControl control{};
    const Wave w = make_wave(variant.path, variant.request, kinds, capacity, floats.data(),
                             uints.data(), nullptr, &control);
    std::fill_n(w.state, capacity, Wave::kFree);
    const Poll watch = [&](double) {
        const double share =
            static_cast<double>(atomic_add(&control.begun, 0)) / static_cast<double>(job.paths());
        try {
            if (!poll || poll(std::min(1.0, share))) return true;
        } catch (...) {
            atomic_next(&control.stopped);
            throw;
        }
        atomic_next(&control.stopped);
        return false;
    };
    ++stats.launches;
    return parallel(
        stats.threads, tile_count(capacity), watch, [&](uint32_t worker, uint64_t tile) {
            try {
                variant.wave_tile(view, job, w, static_cast<uint32_t>(tile), ledgers[worker]);
            } catch (...) {
                atomic_next(&control.stopped);
                throw;
            }
        });
}

}  // namespace
}  // namespace veriray
