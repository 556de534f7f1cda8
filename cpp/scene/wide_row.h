// The N-wide tree of least expected cost that a binary tree contains, built node by node in any
// order: a subtree's row follows from those of its halves, a wide node's place from the rows above.
// H. Ylitie, T. Karras, S. Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed
// Wide BVHs", HPG 2017, section 3.
#pragma once

#include "scene/bvh_build.h"

namespace veriray {

// x (y + z) + y z of a box's edges.
VR_HD float half_area(const float* lo, const float* hi) {
    const float x = hi[0] - lo[0], y = hi[1] - lo[1], z = hi[2] - lo[2];
    return x * (y + z) + y * z;
}

// A subtree represented by at most k children of a wide node: [k - 1].
template <uint32_t N>
struct WideRow {
    float cost[N - 1];     // in units of a visit to a node, times half a surface
    uint32_t wide[N - 1];  // nodes in it; wide[0] is 0 if it is cheaper as a leaf
    uint32_t count;        // slots

    VR_HD bool leaf() const { return wide[0] == 0; }
};

template <uint32_t N>
VR_HD float leaf_cost(float area, uint32_t count, const WalkCost& walk) {
    const uint32_t blocks = (count + walk.block_size - 1) / walk.block_size;
    return count <= walk.max_leaf ? area * walk.block * static_cast<float>(blocks) : kInfinity;
}

template <uint32_t N>
VR_HD WideRow<N> leaf_row(float area, uint32_t count, const WalkCost& walk) {
    WideRow<N> row;
    row.count = count;
    const float cost = leaf_cost<N>(area, count, walk);
    for (uint32_t k = 0; k < N - 1; ++k) row.cost[k] = cost, row.wide[k] = 0;
    return row;
}

// Expected visits and tests of a line through the root's box, in visits to a node.
template <uint32_t N>
double tree_cost(const WideRow<N>& row, const float* lo, const float* hi) {
    const float area = half_area(lo, hi);
    return area > 0 ? static_cast<double>(row.cost[0]) / static_cast<double>(area) : 0;
}

// The split of `slots` children between two subtrees at least cost: the first one's number.
struct Sharing {
    float cost;
    uint32_t first;
};
template <uint32_t N>
VR_HD Sharing share(const WideRow<N>& a, const WideRow<N>& b, uint32_t slots) {
    Sharing best{kInfinity, 1};
    for (uint32_t k = 1; k < slots; ++k) {
        const float c = a.cost[k - 1] + b.cost[slots - k - 1];
        if (c < best.cost) best = {c, k};
    }
    return best;
}

template <uint32_t N>
VR_HD WideRow<N> inner_row(float area, const WideRow<N>& a, const WideRow<N>& b,
                           const WalkCost& walk) {
    WideRow<N> row;
    row.count = a.count + b.count;
    const auto wide = [&](Sharing s, uint32_t slots) {
        return a.wide[s.first - 1] + b.wide[slots - s.first - 1];
    };
    const Sharing all = share(a, b, N);
    const float as_leaf = leaf_cost<N>(area, row.count, walk), as_node = area + all.cost;
    row.cost[0] = as_leaf <= as_node ? as_leaf : as_node;
    row.wide[0] = as_leaf <= as_node ? 0 : 1 + wide(all, N);
    for (uint32_t k = 2; k < N; ++k) {  // fewer children, if that is no worse
        const Sharing s = share(a, b, k);
        const bool better = s.cost < row.cost[k - 2];
        row.cost[k - 1] = better ? s.cost : row.cost[k - 2];
        row.wide[k - 1] = better ? wide(s, k) : row.wide[k - 2];
    }
    return row;
}

// The place of a wide node, the subtree that it holds, and that subtree's first slot.
struct WidePlace {
    uint32_t node, to, first;
};

// The children of the wide node that holds `node`, from left to right; returns how many.
// tree.row(node), tree.child(node, 0 or 1).
template <uint32_t N, class Tree>
VR_HD uint32_t wide_children(const Tree& tree, uint32_t node, uint32_t (&out)[N]) {
    struct Part {
        uint32_t node, slots;
    } stack[N];
    uint32_t size = 0, n = 0;
    const auto divide = [&](uint32_t at, uint32_t slots) {
        const uint32_t a = tree.child(at, 0), b = tree.child(at, 1);
        const uint32_t first = share<N>(tree.row(a), tree.row(b), slots).first;
        stack[size++] = {b, slots - first};
        stack[size++] = {a, first};
    };
    divide(node, N);
    while (size > 0) {
        Part p = stack[--size];
        const WideRow<N>& row = tree.row(p.node);
        if constexpr (N > 2)
            while (p.slots > 1 && row.cost[p.slots - 2] == row.cost[p.slots - 1]) --p.slots;
        if (p.slots > 1)
            divide(p.node, p.slots);
        else
            out[n++] = p.node;
    }
    return n;
}

// x + sign kBoxPad, rounded to that side.
VR_HD float outward(float x, double sign) {
    const double y = x + sign * static_cast<double>(kBoxPad);
    return static_cast<float>(y + sign * 0x1p-23 * (y < 0 ? -y : y));
}

template <uint32_t N>
VR_HD WideNode<N> empty_wide_node() {
    WideNode<N> w;
    for (uint32_t k = 0; k < N; ++k) {
        for (int axis = 0; axis < 3; ++axis) w.lo[axis][k] = kInfinity, w.hi[axis][k] = -kInfinity;
        w.child[k] = kEmptyChild;
    }
    return w;
}

// The wide node for a place; calls inner(place) for children that are nodes, leaf(node, slot) for
// the others. Nodes are in depth-first order. tree.lo(node), tree.hi(node): the node's box.
template <uint32_t N, class Tree, class Inner, class Leaf>
VR_HD WideNode<N> wide_node(const Tree& tree, WidePlace at, Inner inner, Leaf leaf) {
    WideNode<N> out = empty_wide_node<N>();
    uint32_t child[N] = {at.node}, n = 1, next = at.to + 1, first = at.first;
    if (!tree.row(at.node).leaf()) n = wide_children<N>(tree, at.node, child);
    for (uint32_t k = 0; k < n; ++k) {
        const WideRow<N>& row = tree.row(child[k]);
        const float *lo = tree.lo(child[k]), *hi = tree.hi(child[k]);
        for (int axis = 0; axis < 3; ++axis) {
            out.lo[axis][k] = outward(lo[axis], -1.0);
            out.hi[axis][k] = outward(hi[axis], 1.0);
        }
        if (row.leaf()) {
            out.child[k] = kLeafFlag | first << 4 | (row.count - 1);
            leaf(child[k], first);
        } else {
            out.child[k] = next;
            inner(WidePlace{child[k], next, first});
            next += row.wide[0];
        }
        first += row.count;
    }
    return out;
}

}  // namespace veriray
