// What a block of the launches of scheduler `wavefront` does. Device code alone, so that it can be
// compiled at run time as well (run_time/kernel.cuh).
#pragma once

#include "backends/block_ledger.cuh"
#include "integrators/surface.h"
#include "schedulers/walking.h"
#include "schedulers/wavefront.h"

namespace veriray {

inline constexpr uint32_t kWaveBlock = 128;

// Calls body(k) for k < n; the threads of the block share.
template <class Body>
__device__ void each_in_block(uint32_t n, Body body) {
    for (uint32_t k = threadIdx.x; k < n; k += kWaveBlock) body(k);
}

template <class Tracer>
__device__ __forceinline__ void block_refills(const SceneView& scene, const Job& job,
                                              const Wave& w) {
    if (w.queues[blockIdx.x].idle) return;
    __shared__ TileQueues q;
    __shared__ Refill r;
    const uint32_t first = blockIdx.x * kTileSlots;
    if (threadIdx.x == 0) q = {};
    __syncthreads();
    each_in_block(w.slots(first), [&](uint32_t k) { wave_sweep(w, q, first, first + k); });
    __syncthreads();
    if (threadIdx.x == 0) {
        r = wave_take(job, w, q);
        w.queues[blockIdx.x] = q;
    }
    __syncthreads();
    each_in_block(r.begins, [&](uint32_t k) { wave_begin<Tracer>(scene, job, w, r, first, k); });
}

// kExact: the scene has all features of the tracer.
template <class Tracer, bool kExact>
__device__ bool in_tree(const SceneView& scene) {
    return (Tracer::kMask & kBvh) && (kExact || (scene.features & kBvh));
}
template <class Tracer>
using WithoutTree = typename Tracer::template With<Tracer::kMask & ~kBvh>;
// Sets a ray out again that has met the sheet which it has just passed.
template <class Tracer>
__device__ bool again(const SceneView& scene, WalkTask& task, float t_max) {
    if constexpr (Tracer::has(kPass))
        if ((scene.features & kGoOn) &&
            Tracer::same_sheet(scene, task.ray, task.look.last, task.hit, true)) {
            task.look.last.primitive = task.hit.primitive;
            task.hit = {t_max, ~0u};
            return true;
        }
    return false;
}

template <class Tracer, bool kExact = false>
__device__ __forceinline__ void block_traces(const SceneView& scene, const Wave& w) {
    const uint32_t live = w.queues[blockIdx.x].live;
    if (live == 0) return;
    __shared__ TileQueues q;
    __shared__ uint32_t taken;
    if (threadIdx.x == 0) q = w.queues[blockIdx.x], taken = 0;
    fill_block_quads<Tracer::kMask>(scene);
    __syncthreads();
    const uint32_t first = blockIdx.x * kTileSlots;
    if (in_tree<Tracer, kExact>(scene)) {
        const auto start = [&](uint32_t k, WalkTask& task) {
            const auto path = load_path<Tracer, kAhead>(w.paths, w.live[first + k]);
            task = {path.ray, {false, ~0u, Tracer::passed(path)}, {kInfinity, ~0u}};
        };
        walk_queue<Tracer>(scene, live, &taken, start, [&](uint32_t k, WalkTask& task) {
            if (again<Tracer>(scene, task, kInfinity)) return true;
            wave_meets<Tracer>(scene, w, q, first, w.live[first + k], task.hit);
            return false;
        });
    } else {
        each_in_block(live, [&](uint32_t k) {
            wave_trace<Tracer, WithoutTree<Tracer>>(scene, w, q, first, k);
        });
    }
    __syncthreads();
    if (threadIdx.x == 0) w.queues[blockIdx.x] = q;
}

// All hits; kind: those of one queue alone, and with `misses` those of queue 0.
inline constexpr uint32_t kEveryKind = ~0u;
template <class Tracer>
__device__ __forceinline__ void block_scatters(const SceneView& scene, const Job& job,
                                               const Wave& w, uint32_t kind, bool misses,
                                               uint64_t* ledger) {
    if (w.queues[blockIdx.x].live == 0) return;
    __shared__ TileQueues q;
    __shared__ BlockLedger counts;
    if (threadIdx.x == 0) q = w.queues[blockIdx.x];
    counts.clear();
    __syncthreads();
    const auto scatter = [&](uint32_t of, uint32_t k) {
        wave_scatter<Tracer>(
            scene, job, w, q, blockIdx.x * kTileSlots, of, k,
            [&](uint32_t depth, uint32_t column) { counts.record(ledger, depth, column); });
    };
    const uint32_t missed = misses ? hit_places(q, 0) : 0;
    each_in_block(kind == kEveryKind ? hit_places(q) : missed + q.hits[kind], [&](uint32_t k) {
        uint32_t of = kind;
        if (kind == kEveryKind) {
            if (!find_hit(q, of, k)) return;
        } else if (k >= missed) {
            k -= missed;
        } else {
            of = 0;
            if (k >= q.hits[0]) return;
        }
        scatter(of, k);
    });
    __syncthreads();
    if (threadIdx.x == 0) w.queues[blockIdx.x] = q;
    counts.add_to(ledger);
}

template <class Tracer, bool kExact = false>
__device__ __forceinline__ void block_shadows(const SceneView& scene, const Job& job, const Wave& w,
                                              uint64_t* ledger) {
    const uint32_t shadows = w.queues[blockIdx.x].shadows;
    if (shadows == 0) return;
    __shared__ BlockLedger counts;
    __shared__ uint32_t taken;
    if (threadIdx.x == 0) taken = 0;
    counts.clear();
    fill_block_quads<Tracer::kMask>(scene);
    __syncthreads();
    const uint32_t first = blockIdx.x * kTileSlots;
    const auto record = [&](uint32_t depth, uint32_t column) {
        counts.record(ledger, depth, column);
    };
    if (in_tree<Tracer, kExact>(scene)) {
        const bool through = Tracer::shadows_pass(scene);
        typename Tracer::Request shadow;
        const auto start = [&](uint32_t k, WalkTask& task) {
            shadow = wave_request<Tracer>(w, first, k);
            task = {
                shadow.ray, {!through, shadow.skip, Tracer::passed(shadow)}, {shadow.t_max, ~0u}};
        };
        walk_queue<Tracer>(scene, shadows, &taken, start, [&](uint32_t k, WalkTask& task) {
            bool free, goes_on = through;
            if (through) {
                if (again<Tracer>(scene, task, shadow.t_max)) return true;
                free = Tracer::shadow_hit(scene, shadow, task.hit, goes_on);
                if (goes_on) {
                    task.look.last = Tracer::passed(shadow);
                    task.hit = {shadow.t_max, ~0u};
                    return true;
                }
            } else {
                free = !(task.hit.t < shadow.t_max);
                if constexpr (Tracer::has(kMedia))
                    Tracer::attenuate(scene, shadow, shadow.t_max, free);
            }
            wave_deliver<Tracer>(scene, job, w, first, k, shadow, free, record);
            return false;
        });
    } else {
        each_in_block(shadows, [&](uint32_t k) {
            wave_shadow<Tracer, WithoutTree<Tracer>>(scene, job, w, first, k, record);
        });
    }
    __syncthreads();
    counts.add_to(ledger);
}

// Of a tracer, what shades the hits of one kind of material in a tree: hits are as they were
// sorted. Without a tree rims may change them.
template <class Tracer, uint32_t kKind>
using OneKind =
    typename Tracer::template With<(Tracer::kMask & ~(materials(kAllKinds) | kQuads | kPolygons)) |
                                   materials(1u << kKind)>;

// Whether hits are shaded by kind: in a tree, but for blends, whose material follows at the hit.
constexpr bool by_kind(FeatureMask features, uint32_t kinds) {
    const uint32_t several = kinds_of(features);
    return kinds > 1 && (several & (several - 1)) && (features & kBvh) && !(features & kBlend);
}

}  // namespace veriray
