// The scene's tree on the device: built there by `ploc`, or on the host by `sah`.
#pragma once

#include <thrust/iterator/counting_iterator.h>
#include <thrust/iterator/transform_iterator.h>

#include <chrono>
#include <cub/block/block_scan.cuh>
#include <cub/device/device_radix_sort.cuh>
#include <cub/device/device_reduce.cuh>
#include <cub/device/device_scan.cuh>

#include "backends/device.cuh"
#include "backends/instances.h"
#include "scene/ploc.h"

namespace veriray {
namespace {

constexpr uint32_t kTreeBlock = 128;

template <class Body>
__global__ void __launch_bounds__(kTreeBlock)
    each_kernel(const __grid_constant__ Body body, uint32_t n) {
    const uint32_t i = blockIdx.x * kTreeBlock + threadIdx.x;
    if (i < n) body(i);
}

template <class Body>
void each_on_device(uint32_t n, const Body& body) {
    if (n == 0) return;
    each_kernel<<<blocks_for(n, kTreeBlock), kTreeBlock>>>(body, n);
    check_launch("tree");
}

// The rounds that are left for the clusters of one block, one a thread: most rounds merge a few
// hundred. The last cluster ends at the front of the first table.
constexpr uint32_t kFewClusters = 512;
template <uint32_t N>
__global__ void __launch_bounds__(kFewClusters)
    last_rounds_kernel(const __grid_constant__ ploc::Rounds<N> all, uint32_t number) {
    using Scan = cub::BlockScan<uint32_t, kFewClusters>;
    __shared__ typename Scan::TempStorage scratch;
    const uint32_t i = threadIdx.x;
    for (; all.counts[number] > 1; ++number) {
        const ploc::Round round = all.round(number);
        ploc::NearestStep{round}(i);
        __syncthreads();
        uint32_t before;
        Scan(scratch).ExclusiveSum(ploc::KeptFlag{round}(i), before);
        if (i < *round.count) all.offset[i] = before;
        all.merge(number)(i);
        __syncthreads();
    }
    if (i == 0) all.clusters[0][0] = all.clusters[number % 2][0];
}

// Executor of scene/ploc.h, on the default stream.
class TreeExec {
   public:
    static constexpr uint32_t kRounds = 4, kFew = kFewClusters;

    explicit TreeExec(const BuildPoll& poll) : poll_(poll) {}

    void* memory(size_t bytes) {
        memory_ = Scratch<char>(bytes, "tree");
        return memory_.get();
    }
    template <class Body>
    void each(uint32_t n, const Body& body) {
        each_on_device(n, body);
    }
    template <class Body, class Join, class T>
    void reduce(uint32_t n, const Body& body, const Join& join, T none, T* out) {
        with_scratch([&](void* scratch, size_t& bytes) {
            return cub::DeviceReduce::Reduce(scratch, bytes, results_of(body), out,
                                             static_cast<int>(n), join, none);
        });
    }
    const uint32_t* sort(uint32_t n, uint32_t bits, uint64_t* const* keys,
                         uint32_t* const* values) {
        cub::DoubleBuffer<uint64_t> key(keys[0], keys[1]);
        cub::DoubleBuffer<uint32_t> value(values[0], values[1]);
        with_scratch([&](void* scratch, size_t& bytes) {
            return cub::DeviceRadixSort::SortPairs(scratch, bytes, key, value, static_cast<int>(n),
                                                   0, static_cast<int>(bits));
        });
        return value.Current();
    }
    template <class Flag>
    void sum(uint32_t n, const Flag& flag, uint32_t* out) {
        with_scratch([&](void* scratch, size_t& bytes) {
            return cub::DeviceScan::ExclusiveSum(scratch, bytes, results_of(flag), out,
                                                 static_cast<int>(n));
        });
    }
    template <uint32_t N>
    const ploc::Cluster* last(const ploc::Rounds<N>& all, uint32_t number) {
        last_rounds_kernel<<<1, kFewClusters>>>(all, number);
        check_launch("tree");
        return all.clusters[0];
    }
    void clear(uint32_t* p, size_t n) { check(cudaMemset(p, 0, n * sizeof *p), "tree"); }
    template <class T>
    T read(const T* p) {
        T value;
        check(cudaMemcpy(&value, p, sizeof value, cudaMemcpyDeviceToHost), "tree");
        return value;
    }
    void progress(double share) {
        keeping_device([&] { go_on(poll_, share); });
    }

   private:
    template <class Body>
    static auto results_of(const Body& body) {
        return thrust::make_transform_iterator(thrust::make_counting_iterator(0u), body);
    }
    // call(null, bytes) tells what call(scratch, bytes) needs.
    template <class Call>
    void with_scratch(Call call) {
        size_t bytes = 0;
        check(call(nullptr, bytes), "tree");
        if (bytes > scratch_.size()) {
            wait_for_default("tree");  // for what still uses the smaller one
            scratch_ = Scratch<char>(bytes, "tree");
        }
        check(call(scratch_.get(), bytes), "tree");
    }

    const BuildPoll& poll_;
    Scratch<char> memory_, scratch_;
};

// out[slot] = in[order[slot]], records of kRecordFloats, a quarter a thread.
struct GatherStep {
    const float4* in;
    const uint32_t* order;
    float4* out;
    VR_HD void operator()(uint32_t i) const {
        out[i] = in[static_cast<size_t>(order[i / 4]) * 4 + i % 4];
    }
};

// in: on the device.
inline DeviceTree build_on_device(const TreeInput& in, const BuildPoll& poll,
                                  Scratch<uint32_t>& order) {
    DeviceTree out;
    wait_for_default("tree");
    const auto start = std::chrono::steady_clock::now();
    TreeExec exec(poll);
    ploc::Builder<kDeviceWidth, TreeExec> builder(exec, in, kScalarWalk);
    const ploc::Node<kDeviceWidth> root = builder.merge();
    out.nodes = {std::max<size_t>(1, root.row.wide[0]), "tree"};
    order = {in.count, "tree"};
    builder.emit(root, out.nodes.get(), order.get());
    wait_for_default("tree");
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - start;
    out.info.depth = root.depth;
    out.info.cost = tree_cost(root.row, root.lo, root.hi);
    out.info.seconds = seconds.count();
    return out;
}

}  // namespace
}  // namespace veriray
