// Wide trees from the binary trees of the host.
#include <chrono>
#include <stdexcept>
#include <string>

#include "scene/wide_row.h"

namespace veriray {
namespace {

template <uint32_t N>
struct Rows {
    const std::vector<BinaryNode>& nodes;
    std::vector<WideRow<N>> rows;

    const WideRow<N>& row(uint32_t node) const { return rows[node]; }
    uint32_t child(uint32_t node, uint32_t side) const { return nodes[node].left_or_first + side; }
    const float* lo(uint32_t node) const { return nodes[node].lo; }
    const float* hi(uint32_t node) const { return nodes[node].hi; }
};

}  // namespace

template <uint32_t N>
WideTree<N> collapse(const BuiltBvh& bvh, WalkCost walk) {
    if (bvh.order.size() > 1u << 27)
        throw std::invalid_argument(std::to_string(bvh.order.size()) +
                                    " references; a tree holds at most 2^27");
    const auto start = std::chrono::steady_clock::now();
    walk.max_leaf = std::clamp(walk.max_leaf, 2u, kMaxLeaf);
    WideTree<N> out{{empty_wide_node<N>()}, bvh.order, bvh.depth, 0, bvh.seconds};
    if (bvh.nodes.empty()) return out;
    Rows<N> tree{bvh.nodes, std::vector<WideRow<N>>(bvh.nodes.size())};
    for (size_t i = bvh.nodes.size(); i-- > 0;) {
        const BinaryNode& n = bvh.nodes[i];
        const float area = half_area(n.lo, n.hi);
        tree.rows[i] = n.count ? leaf_row<N>(area, n.count, walk)
                               : inner_row<N>(area, tree.rows[n.left_or_first],
                                              tree.rows[n.left_or_first + 1], walk);
    }
    out.nodes.resize(std::max(1u, tree.rows[0].wide[0]));
    out.cost = tree_cost(tree.rows[0], bvh.nodes[0].lo, bvh.nodes[0].hi);
    std::vector<WidePlace> stack{{0, 0, 0}};
    while (!stack.empty()) {
        const WidePlace at = stack.back();
        stack.pop_back();
        out.nodes[at.to] = wide_node<N>(
            tree, at, [&](WidePlace p) { stack.push_back(p); }, [](uint32_t, uint32_t) {});
    }
    out.seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return out;
}
template WideTree<2> collapse(const BuiltBvh&, WalkCost);
template WideTree<4> collapse(const BuiltBvh&, WalkCost);
template WideTree<8> collapse(const BuiltBvh&, WalkCost);
template WideTree<16> collapse(const BuiltBvh&, WalkCost);

}  // namespace veriray
