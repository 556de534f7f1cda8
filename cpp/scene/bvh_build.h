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

// A subtree's slots are consecutive. nodes[0] is the root; without primitives there are no nodes.
struct BuiltBvh {
    std::vector<uint32_t> order;  // slot -> primitive; one that was split has several slots
    std::vector<BinaryNode> nodes;
    uint32_t depth = 0;  // inner nodes on the longest path
    double seconds = 0;
};

// What a walk pays, in units of a visit of a node, and the largest leaf (2 to 16).
struct WalkCost {
    float block;          // for one block of records
    uint32_t block_size;  // records that are tested at once
    uint32_t max_leaf;
};
inline constexpr WalkCost kSimdWalk{1.f, 8, 8}, kScalarWalk{1.f, 1, 8};

// lo, hi: (n, 3). triangle_vertices: (n, 9), a row that starts with NaN is no triangle; null:
// primitives are never split. walk: what it tests at once stays together, unless triangles are
// split. threads: 0 for all; the tree does not depend on it.
// progress(share done) is called on this thread about every 50 ms; false stops the build.
// Throws std::invalid_argument for more than 2^27 primitives, an empty box, or one that leaves
// [-2^60, 2^60]; std::runtime_error if stopped; what progress throws.
BuiltBvh build_bvh(const float* lo, const float* hi, const float* triangle_vertices, uint32_t n,
                   const WalkCost& walk, uint32_t threads,
                   const std::function<bool(double)>& progress);

// The N-wide tree (2, 4 or 8) of least expected cost that the binary one holds: leaves too are
// chosen here. Boxes are padded by kBoxPad, nodes are in depth-first order; nodes[0] is the root,
// also of a tree that is one leaf or empty. At most kMaxBvhDepth nodes lie on a path.
// Throws std::invalid_argument for more than 2^27 references.
template <uint32_t N>
std::vector<WideNode<N>> collapse(const BuiltBvh& bvh, const WalkCost& cost = kSimdWalk);

}  // namespace veriray
