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
        const uint32_t parts = (q.live + kPart - 1) / kPart;
        uint32_t* const list = w.parts + atomicAdd(&w.control->parts, parts);
        for (uint32_t part = 0; part < parts; ++part) list[part] = first + part * kPart;
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

// One queue of all tiles. A warp takes a part of a tile's at a time and goes on without waiting for
// the rays that it has, so that lanes idle only at the end of the launch. size(tile): of a tile's
// queue; `taken`: parts that warps have.
template <class Size>
class SharedQueue {
   public:
    __device__ SharedQueue(const Wave& w, uint32_t* taken, Size size)
        : w_(w), taken_(taken), size_(size) {}

    __device__ bool more() const { return more_; }
    __device__ uint32_t take(bool wants) {
        const uint32_t lane = threadIdx.x & 31u;
        uint32_t place = kNoPlace;
        while (const uint32_t lanes = more_ ? __ballot_sync(~0u, wants) : 0) {
            if (next_ == end_) {
                uint32_t part = 0;
                if (lane == 0) part = atomicAdd(taken_, 1u);
                part = __shfl_sync(~0u, part, 0);
                more_ = part < w_.control->parts;
                if (!more_) break;
                next_ = w_.parts[part];
                const uint32_t tile = next_ / kTileSlots, end = tile * kTileSlots + size_(tile);
                end_ = max(next_, min(end, next_ + kPart));
            }
            const uint32_t before = lanes & ((1u << lane) - 1u);
            const uint32_t mine = next_ + static_cast<uint32_t>(__popc(before));
            if (wants && mine < end_) place = mine, wants = false;
            next_ = min(end_, next_ + static_cast<uint32_t>(__popc(lanes)));
        }
        return place;
    }

   private:
    const Wave& w_;
    uint32_t* const taken_;
    const Size size_;
    uint32_t next_ = 0, end_ = 0;
    bool more_ = true;
};

template <class Tracer, bool kExact = false>
__device__ __forceinline__ void block_traces(const SceneView& scene, const Wave& w) {
    if (in_tree<Tracer, kExact>(scene)) {
        const auto size = [&](uint32_t tile) { return w.queues[tile].live; };
        const auto start = [&](uint32_t k, WalkTask& task) {
            const auto path = load_path<Tracer, kAhead>(w.paths, w.live[k]);
            task = {path.ray, {false, ~0u, Tracer::passed(path)}, {kInfinity, ~0u}};
        };
        const auto arrive = [&](uint32_t k, WalkTask& task) {
            if (again<Tracer>(scene, task, kInfinity)) return true;
            wave_meets(w, w.live[k], task.hit);
            return false;
        };
        walk_queue<Tracer>(scene, SharedQueue(w, &w.control->traced, size), start, arrive);
        return;
    }
    const uint32_t live = w.queues[blockIdx.x].live;
    if (live == 0) return;
    fill_block_quads<Tracer::kMask>(scene);
    __syncthreads();
    const uint32_t first = blockIdx.x * kTileSlots;
    each_in_block(live,
                  [&](uint32_t k) { wave_trace<Tracer, WithoutTree<Tracer>>(scene, w, first, k); });
}

// All hits; kind: those of one queue alone, and with `misses` those of queue 0. The first of these
// launches sorts, by Sorter, the tracer for all kinds.
inline constexpr uint32_t kEveryKind = ~0u;
template <class Tracer, class Sorter = Tracer>
__device__ __forceinline__ void block_scatters(const SceneView& scene, const Job& job,
                                               const Wave& w, uint32_t kind, bool misses,
                                               uint64_t* ledger) {
    const uint32_t live = w.queues[blockIdx.x].live;
    if (live == 0) return;
    __shared__ TileQueues q;
    __shared__ BlockLedger counts;
    if (threadIdx.x == 0) q = w.queues[blockIdx.x];
    counts.clear();
    __syncthreads();
    if (kind == kEveryKind || misses) {
        each_in_block(
            live, [&](uint32_t k) { wave_sort<Sorter>(scene, w, q, blockIdx.x * kTileSlots, k); });
        __syncthreads();
    }
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
    const bool tree = in_tree<Tracer, kExact>(scene);
    const uint32_t shadows = w.queues[blockIdx.x].shadows;
    if (!tree && shadows == 0) return;
    __shared__ BlockLedger counts;
    counts.clear();
    fill_block_quads<Tracer::kMask>(scene);
    __syncthreads();
    const auto record = [&](uint32_t depth, uint32_t column) {
        counts.record(ledger, depth, column);
    };
    if (tree) {
        const auto size = [&](uint32_t tile) { return w.queues[tile].shadows; };
        const bool through = Tracer::shadows_pass(scene);
        typename Tracer::Request shadow;
        const auto start = [&](uint32_t k, WalkTask& task) {
            shadow = wave_request<Tracer>(w, 0, k);
            task = {
                shadow.ray, {!through, shadow.skip, Tracer::passed(shadow)}, {shadow.t_max, ~0u}};
        };
        const auto arrive = [&](uint32_t k, WalkTask& task) {
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
                shadow = wave_request<Tracer>(w, 0, k);  // not held in registers on the way
                free = !(task.hit.t < shadow.t_max);
                if constexpr (Tracer::has(kMedia))
                    Tracer::attenuate(scene, shadow, shadow.t_max, free);
            }
            wave_deliver<Tracer>(scene, job, w, 0, k, shadow, free, record);
            return false;
        };
        walk_queue<Tracer>(scene, SharedQueue(w, &w.control->shadowed, size), start, arrive);
    } else {
        const uint32_t first = blockIdx.x * kTileSlots;
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
