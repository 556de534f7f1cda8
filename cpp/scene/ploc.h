// A parallel builder: clusters in Morton order merge with their nearest neighbours, round by round.
// D. Meister, J. Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy
// Construction", TVCG 2018.
//
// An executor runs the functions below on the host or on CUDA, and the tree is the same on both:
// ties between equally near clusters are broken by position, and positions follow from prefix sums,
// not from the order of execution. At worst only one pair per round is mutually nearest. So that
// there are at most kMaxBvhDepth rounds, and inner nodes on a path, adjacent clusters merge in
// pairs from the round on where halving their number in each round just suffices.
#pragma once

#include <algorithm>

#include "scene/wide_row.h"

namespace veriray::ploc {

inline constexpr uint32_t kRadius = 8;  // neighbours on either side that a cluster looks at
inline constexpr uint32_t kMortonBits = 21;
inline constexpr uint32_t kLeaf = ~0u;

// Twice the boxes' centres.
struct CentreBox {
    float lo[3], hi[3];
};
struct CentreOf {
    TreeInput in;
    VR_HD CentreBox operator()(uint32_t primitive) const {
        CentreBox b;
        in.box(primitive, b.lo, b.hi);
        for (int k = 0; k < 3; ++k) b.lo[k] = b.hi[k] = b.lo[k] + b.hi[k];
        return b;
    }
};
struct JoinCentres {
    VR_HD CentreBox operator()(const CentreBox& a, const CentreBox& b) const {
        CentreBox out;
        for (int k = 0; k < 3; ++k)
            out.lo[k] = min(a.lo[k], b.lo[k]), out.hi[k] = max(a.hi[k], b.hi[k]);
        return out;
    }
};
VR_HD CentreBox no_centres() {
    return {{kInfinity, kInfinity, kInfinity}, {-kInfinity, -kInfinity, -kInfinity}};
}

// The lowest kMortonBits bits of x, two zeros between neighbours.
VR_HD uint64_t spread_bits(uint64_t x) {
    x = (x | x << 32) & 0x001f00000000ffffull;
    x = (x | x << 16) & 0x001f0000ff0000ffull;
    x = (x | x << 8) & 0x100f00f00f00f00full;
    x = (x | x << 4) & 0x10c30c30c30c30c3ull;
    return (x | x << 2) & 0x1249249249249249ull;
}

// The position of a primitive's centre on the Morton curve.
struct MortonStep {
    TreeInput in;
    const CentreBox* range;
    uint64_t* key;
    uint32_t* primitive;

    VR_HD void operator()(uint32_t i) const {
        const CentreBox c = CentreOf{in}(i);
        uint64_t code = 0;
        for (int k = 0; k < 3; ++k) {
            const float width = range->hi[k] - range->lo[k];
            // The largest centre falls short of 2^kMortonBits, however the product is rounded.
            const float cells = static_cast<float>(1u << kMortonBits) * (1.f - 0x1p-20f);
            const float scale = width > 0x1p-100f ? cells / width : 0.f;
            code |= spread_bits(to_uint((c.lo[k] - range->lo[k]) * scale)) << k;
        }
        key[i] = code;
        primitive[i] = i;
    }
};

// A node of the binary tree and its cost; leaves are 0 to n - 1, in Morton order.
template <uint32_t N>
struct alignas(16) Node {
    float lo[3], hi[3];
    uint32_t child[2];  // a leaf: primitive, kLeaf
    WideRow<N> row;
    uint32_t depth;
};

template <uint32_t N>
struct Tree {
    Node<N>* nodes;
    VR_HD const WideRow<N>& row(uint32_t node) const { return nodes[node].row; }
    VR_HD uint32_t child(uint32_t node, uint32_t side) const { return nodes[node].child[side]; }
    VR_HD const float* lo(uint32_t node) const { return nodes[node].lo; }
    VR_HD const float* hi(uint32_t node) const { return nodes[node].hi; }
};

// first: the leaf that it began as; no other cluster has the same.
struct alignas(16) Cluster {
    float lo[3];
    uint32_t node;
    float hi[3];
    uint32_t first;
};

template <uint32_t N>
struct LeafStep {
    TreeInput in;
    WalkCost walk;
    const uint32_t* primitive;  // in Morton order
    Node<N>* nodes;
    Cluster* clusters;

    VR_HD void operator()(uint32_t i) const {
        Node<N> node;
        in.box(primitive[i], node.lo, node.hi);
        node.child[0] = primitive[i], node.child[1] = kLeaf;
        node.row = leaf_row<N>(half_area(node.lo, node.hi), 1, walk);
        node.depth = 0;
        nodes[i] = node;
        Cluster c;
        for (int k = 0; k < 3; ++k) c.lo[k] = node.lo[k], c.hi[k] = node.hi[k];
        c.node = c.first = i;
        clusters[i] = c;
    }
};

VR_HD Cluster joined(const Cluster& a, const Cluster& b) {
    Cluster out = a;
    for (int k = 0; k < 3; ++k)
        out.lo[k] = min(a.lo[k], b.lo[k]), out.hi[k] = max(a.hi[k], b.hi[k]);
    return out;
}

VR_HD uint32_t bit_width(uint32_t x) {
    uint32_t bits = 0;
    for (; x; x >>= 1) ++bits;
    return bits;
}

// One round. The clusters i and j = nearest[i] merge, at the place of the first, if nearest[j] = i.
// Pairs are strictly ordered by the surface of their union, then by i ^ j, then by the lesser of i
// and j. So at least one pair merges, and if all clusters are equally near, half of them do.
struct Round {
    const Cluster* from;
    const uint32_t* count;  // clusters now; count[1]: after the round
    uint32_t number;
    uint32_t* nearest;

    VR_HD bool kept(uint32_t i) const {
        const uint32_t j = nearest[i];
        return j >= i || nearest[j] != i;
    }
};

struct NearestStep : Round {
    VR_HD void operator()(uint32_t i) const {
        const uint32_t n = *count;
        if (i >= n) return;
        if (bit_width(n - 1) >= kMaxBvhDepth - number) {
            nearest[i] = (i ^ 1u) < n ? i ^ 1u : i;
            return;
        }
        const Cluster own = from[i];
        const uint32_t end = i + kRadius < n ? i + kRadius + 1 : n;
        uint64_t least = ~0ull;
        for (uint32_t j = i > kRadius ? i - kRadius : 0; j < end; ++j) {
            if (j == i) continue;
            const Cluster both = joined(own, from[j]);
            const uint64_t key =
                static_cast<uint64_t>(as_uint(half_area(both.lo, both.hi) + 0.f)) << 32 | (i ^ j);
            if (key < least) least = key;
        }
        nearest[i] = least == ~0ull ? i : i ^ static_cast<uint32_t>(least);
    }
};

struct KeptFlag : Round {
    VR_HD uint32_t operator()(uint32_t i) const { return i < *count && kept(i); }
};

template <uint32_t N>
struct MergeStep : Round {
    const uint32_t* offset;  // exclusive sums of KeptFlag
    Cluster* to;
    uint32_t* count_after;
    Node<N>* nodes;
    uint32_t leaves;
    WalkCost walk;

    VR_HD void operator()(uint32_t i) const {
        const uint32_t n = *count, j = i < n ? nearest[i] : 0;
        if (i >= n) return;
        if (i == n - 1) *count_after = offset[i] + kept(i);
        if (!kept(i)) return;
        Cluster c = from[i];
        if (j != i && nearest[j] == i) {
            const Cluster other = from[j];
            const Node<N>&a = nodes[c.node], &b = nodes[other.node];
            Node<N> node;
            node.child[0] = c.node, node.child[1] = other.node;
            c = joined(c, other);
            for (int k = 0; k < 3; ++k) node.lo[k] = c.lo[k], node.hi[k] = c.hi[k];
            node.row = inner_row<N>(half_area(c.lo, c.hi), a.row, b.row, walk);
            node.depth = 1 + (a.depth > b.depth ? a.depth : b.depth);
            // A cluster is absorbed only once, so its number is free for the node.
            c.node = leaves + other.first;
            nodes[c.node] = node;
        }
        to[offset[i]] = c;
    }
};

// What all rounds share.
template <uint32_t N>
struct Rounds {
    Cluster* clusters[2];  // before even rounds, and before odd ones
    uint32_t *counts, *nearest, *offset;
    Node<N>* nodes;
    uint32_t leaves;
    WalkCost walk;

    VR_HD Round round(uint32_t number) const {
        return {clusters[number % 2], counts + number, number, nearest};
    }
    VR_HD MergeStep<N> merge(uint32_t number) const {
        return {round(number), offset, clusters[(number + 1) % 2], counts + number + 1, nodes,
                leaves,        walk};
    }
};

// One level of the wide tree: writes its nodes to their places, in any order.
template <uint32_t N>
struct EmitStep {
    Tree<N> tree;
    const WidePlace* from;
    const uint32_t* count;
    WidePlace* to;
    uint32_t* count_after;
    WideNode<N>* nodes;
    uint32_t* order;

    VR_HD void operator()(uint32_t i) const {
        if (i >= *count) return;
        const WidePlace at = from[i];
        nodes[at.to] = wide_node<N>(
            tree, at, [&](WidePlace p) { to[atomic_next(count_after)] = p; },
            [&](uint32_t node, uint32_t slot) {
                uint32_t stack[kMaxLeaf] = {node}, size = 1;
                while (size > 0) {
                    const uint32_t (&child)[2] = tree.nodes[stack[--size]].child;
                    if (child[1] == kLeaf) {
                        order[slot++] = child[0];
                    } else {
                        stack[size++] = child[1];
                        stack[size++] = child[0];
                    }
                }
            });
    }
};

struct SetStep {
    uint32_t* p;
    uint32_t value;
    VR_HD void operator()(uint32_t) const { *p = value; }
};
struct RootStep {
    WidePlace* p;
    uint32_t root;
    VR_HD void operator()(uint32_t) const { *p = {root, 0, 0}; }
};

// Memory of one build, without the tree: 216 bytes per primitive for N = 4.
template <uint32_t N>
struct Memory {
    Node<N>* nodes;
    Cluster* clusters[2];
    uint64_t* keys[2];
    uint32_t* primitives[2];
    CentreBox* range;
    uint32_t* counts;  // clusters by round, nodes by level

    static constexpr uint32_t kCounts = kMaxBvhDepth + 2;

    // Lays it out from `base` on and returns its size in bytes; null: only the size.
    size_t lay_out(char* base, size_t n) {
        size_t used = 0;
        const auto take = [&]<class T>(T*& p, size_t count) {
            p = base ? reinterpret_cast<T*>(base + used) : nullptr;
            used += (count * sizeof(T) + 255) / 256 * 256;
        };
        take(nodes, 2 * n), take(range, 1), take(counts, 2 * kCounts);
        for (int k = 0; k < 2; ++k) take(clusters[k], n), take(keys[k], n), take(primitives[k], n);
        return used;
    }
};

// An executor has
//   memory(bytes)                  memory for the build, where its functions run
//   each(n, body)                  body(i) for i < n, in any order
//   reduce(n, body, join, none, out)  *out = all body(i) joined
//   sort(n, bits, keys, values)    pairs by key, stable; returns where the values then are
//   sum(n, flag, out)              out[i] = flag(0) + ... + flag(i - 1)
//   clear(p, n)                    zeros
//   read(p)                        *p, once all before is done
//   kRounds                        rounds begun between two reads of the number of clusters
//   kFew, last(rounds, number)     all rounds from `number` on, for at most so many clusters; where
//                                  the last cluster then is. kFew = 0: not used
//   progress(share)                may throw
template <uint32_t N, class Exec>
class Builder {
   public:
    Builder(Exec& exec, const TreeInput& in, WalkCost walk) : exec_(exec), in_(in), walk_(walk) {
        walk_.max_leaf = walk.max_leaf < 2          ? 2
                         : walk.max_leaf > kMaxLeaf ? kMaxLeaf
                                                    : walk.max_leaf;
        const size_t bytes = memory_.lay_out(nullptr, in.count);
        memory_.lay_out(static_cast<char*>(exec.memory(bytes)), in.count);
    }

    // Builds the binary tree and returns its root. There must be at least one primitive.
    Node<N> merge() {
        const uint32_t n = in_.count;
        Memory<N>& m = memory_;
        exec_.reduce(n, CentreOf{in_}, JoinCentres{}, no_centres(), m.range);
        exec_.each(n, MortonStep{in_, m.range, m.keys[0], m.primitives[0]});
        const uint32_t* order = exec_.sort(n, 3 * kMortonBits, m.keys, m.primitives);
        exec_.each(n, LeafStep<N>{in_, walk_, order, m.nodes, m.clusters[0]});
        exec_.clear(m.counts, 2 * Memory<N>::kCounts);
        exec_.each(1, SetStep{m.counts, n});
        const Rounds<N> all{{m.clusters[0], m.clusters[1]},
                            m.counts,
                            reinterpret_cast<uint32_t*>(m.keys[0]),
                            reinterpret_cast<uint32_t*>(m.keys[1]),
                            m.nodes,
                            n,
                            walk_};
        uint32_t bound = n, number = 0;
        for (; bound > std::max(1u, Exec::kFew); ++number) {
            exec_.each(bound, NearestStep{all.round(number)});
            exec_.sum(bound, KeptFlag{all.round(number)}, all.offset);
            exec_.each(bound, all.merge(number));
            if (number + 1 == kMaxBvhDepth || (number + 1) % Exec::kRounds == 0) {
                bound = exec_.read(m.counts + number + 1);
                exec_.progress(1 - static_cast<double>(bound) / n);
            }
        }
        const Cluster* last = m.clusters[number % 2];
        if constexpr (Exec::kFew > 0) last = exec_.last(all, number);
        root_ = exec_.read(last).node;
        return exec_.read(m.nodes + root_);
    }

    // The wide tree of merge()'s `root`: max(1, root.row.wide[0]) nodes; order: one slot per
    // primitive.
    void emit(const Node<N>& root, WideNode<N>* nodes, uint32_t* order) {
        Memory<N>& m = memory_;
        uint32_t* const counts = m.counts + Memory<N>::kCounts;
        WidePlace* const places[2] = {reinterpret_cast<WidePlace*>(m.clusters[0]),
                                      reinterpret_cast<WidePlace*>(m.clusters[1])};
        exec_.each(1, SetStep{counts, 1});
        exec_.each(1, RootStep{places[0], root_});
        const uint32_t most = root.row.leaf() ? 1 : root.row.wide[0];
        uint32_t bound = 1;
        for (uint32_t level = 0; level <= root.depth; ++level) {
            exec_.each(bound, EmitStep<N>{{m.nodes},
                                          places[level % 2],
                                          counts + level,
                                          places[(level + 1) % 2],
                                          counts + level + 1,
                                          nodes,
                                          order});
            bound = bound < most / N ? bound * N : most;
        }
    }

   private:
    Exec& exec_;
    TreeInput in_;
    WalkCost walk_;
    Memory<N> memory_;
    uint32_t root_ = 0;
};

}  // namespace veriray::ploc
