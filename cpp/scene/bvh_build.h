// Builds bounding volume hierarchies: the host's binary tree, and wide trees for the walks.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "geometry/bvh.h"

namespace veriray {

inline constexpr uint32_t kMaxBvhDepth = 62;  // inner nodes on a path from the root to a leaf

enum class TreeBuilder : uint32_t { kSah, kPloc };
inline constexpr const char* kTreeBuilders[] = {"sah", "ploc"};

// share done -> go on
using BuildPoll = std::function<bool(double)>;
// Throws std::runtime_error if poll stops the build, and whatever poll throws.
void go_on(const BuildPoll& poll, double share);

// The primitives of a tree: records by primitive, triangles first, then boxes of the others.
struct TreeInput {
    const float* records;      // kRecordFloats each
    const float* round_boxes;  // lo, hi: 6 floats each, from primitive `triangles` on
    uint32_t triangles, count;

    VR_HD void box(uint32_t primitive, float (&lo)[3], float (&hi)[3]) const {
        const float* r = primitive < triangles
                             ? records + static_cast<size_t>(primitive) * kRecordFloats
                             : round_boxes + static_cast<size_t>(primitive - triangles) * 6;
        for (int k = 0; k < 3; ++k) {
            lo[k] = r[k], hi[k] = r[3 + k];
            if (primitive >= triangles) continue;
            lo[k] = min(min(r[k], r[3 + k]), r[6 + k]);
            hi[k] = max(max(r[k], r[3 + k]), r[6 + k]);
        }
    }
};

// count 0: an inner node, with children at left_or_first and the next index, both after their
// parent. Else a leaf: slots [left_or_first, left_or_first + count). Boxes are not padded.
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

// The costs of a traversal, in units of a visit to a node, and the largest leaf (2 to 16).
struct WalkCost {
    float block;          // for one block of records
    uint32_t block_size;  // records that are tested at once
    uint32_t max_leaf;
};
template <uint32_t kLanes>
inline constexpr WalkCost kSimdWalk{1.f, kLanes, kLanes};
inline constexpr WalkCost kScalarWalk{1.f, 1, 8};

// The `sah` builder. walk: records that it tests at once stay together, unless triangles are split.
// threads: 0 for all; the tree does not depend on it.
// progress(share done) is called on this thread about every 50 ms; false stops the build.
// Throws std::invalid_argument for more than 2^27 primitives, an empty box, or one that leaves
// [-2^60, 2^60]; std::runtime_error if stopped; whatever progress throws.
BuiltBvh build_bvh(const TreeInput& in, const WalkCost& walk, uint32_t threads,
                   const BuildPoll& progress);

// A tree as the traversal reads it. Boxes are padded by kBoxPad, and nodes are in depth-first
// order. nodes[0] is the root, even if the tree is one leaf or empty. At most kMaxBvhDepth nodes
// lie on a path.
template <uint32_t N>
struct WideTree {
    std::vector<WideNode<N>> nodes;
    std::vector<uint32_t> order;  // slot -> primitive
    uint32_t depth = 0;           // of the binary tree
    double cost = 0;              // of a line through the root's box, in visits to a node
    double seconds = 0;
};

// The N-wide tree (2, 4, 8 or 16) of least expected cost that the binary tree contains; this also
// chooses the leaves. Throws std::invalid_argument for more than 2^27 references.
template <uint32_t N>
WideTree<N> collapse(const BuiltBvh& bvh, WalkCost walk);

// The `ploc` builder on the host; see scene/ploc.h. The primitives' boxes are finite and not empty.
// threads, progress: as for build_bvh.
template <uint32_t N>
WideTree<N> build_ploc(const TreeInput& in, WalkCost walk, uint32_t threads,
                       const BuildPoll& progress);

template <uint32_t N>
WideTree<N> build_tree(const TreeInput& in, TreeBuilder builder, const WalkCost& walk,
                       uint32_t threads, const BuildPoll& progress) {
    if (builder == TreeBuilder::kPloc) return build_ploc<N>(in, walk, threads, progress);
    return collapse<N>(build_bvh(in, walk, threads, progress), walk);
}

}  // namespace veriray
