// Builds bounding volume hierarchies on the host: a binary tree, and wide trees for the walks.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "geometry/bvh.h"

namespace veriray {

inline constexpr uint32_t kMaxBvhDepth = 62;  // inner nodes on a path from the root to a leaf

// count 0: inner, children at left_or_first and the next index, both behind their parent.
// Else a leaf: slots [left_or_first, left_or_first + count). Boxes are not padded.
struct BinaryNode {
    float lo[3], hi[3];
    uint32_t left_or_first, count;
};

// A subtree's slots are consecutive. nodes[0] is the root; without primitives, or if stopped, there
// are no nodes.
struct BuiltBvh {
    std::vector<uint32_t> order;  // slot -> primitive; one that was split has several slots
    std::vector<BinaryNode> nodes;
    uint32_t depth = 0;  // inner nodes on the longest path
    double seconds = 0;
};

// lo, hi: (n, 3), finite. triangle_vertices: (n, 9), a row that starts with NaN is no triangle;
// null: primitives are never split. The tree does not depend on `threads`. progress(share done) is
// called on this thread about every 50 ms; false stops the build. Throws std::invalid_argument for
// more than 2^27 primitives.
BuiltBvh build_bvh(const float* lo, const float* hi, const float* triangle_vertices, uint32_t n,
                   uint32_t threads, const std::function<bool(double)>& progress);

// What a walk pays, in units of one node's visit, and the largest leaf (at most 16).
struct WalkCost {
    float block;          // for one block of records
    uint32_t block_size;  // records that are tested at once
    uint32_t max_leaf;
};
inline constexpr WalkCost kSimdWalk{1.f, 8, 8}, kScalarWalk{1.f, 1, 8};

// The tree of N-wide nodes of least expected cost that the binary one holds, with padded boxes, in
// depth-first order; nodes[0] is the root, also of a tree that is one leaf or empty.
// N = 2, 4, 8.
template <uint32_t N>
std::vector<WideNode<N>> collapse(const BuiltBvh& bvh, const WalkCost& cost = kSimdWalk);

}  // namespace veriray
