// Wide trees of least expected cost, by dynamic programming over the binary tree's subtrees.
// H. Ylitie, T. Karras, S. Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed
// Wide BVHs", HPG 2017, section 3.
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "scene/bvh_build.h"

namespace veriray {
namespace {

float half_area(const BinaryNode& n) {
    const float x = n.hi[0] - n.lo[0], y = n.hi[1] - n.lo[1], z = n.hi[2] - n.lo[2];
    return x * (y + z) + y * z;
}

template <uint32_t N>
class Collapse {
   public:
    Collapse(const BuiltBvh& bvh, const WalkCost& cost)
        : nodes_(bvh.nodes), walk_(cost), table_(bvh.nodes.size()) {
        walk_.max_leaf = std::clamp(walk_.max_leaf, 2u, kMaxLeaf);
        for (size_t i = nodes_.size(); i-- > 0;) fill(i);
    }

    std::vector<WideNode<N>> run() {
        out_.emplace_back(empty());
        if (nodes_.empty()) return std::move(out_);
        struct Item {
            uint32_t from, to, slot;
        };
        std::vector<Item> stack;
        const auto add = [&](uint32_t from, uint32_t to, uint32_t slot) {
            put_box(out_[to], slot, nodes_[from]);
            if (table_[from].leaf)
                out_[to].child[slot] = leaf(from);
            else
                stack.push_back({from, to, slot});
        };
        const auto add_children = [&](uint32_t from, uint32_t to) {
            uint32_t child[N], n = 0;
            spread(from, N, child, n);
            while (n-- > 0) add(child[n], to, n);
        };
        if (table_[0].leaf)
            add(0, 0, 0);
        else
            add_children(0, 0);
        while (!stack.empty()) {
            const Item at = stack.back();
            stack.pop_back();
            const uint32_t to = static_cast<uint32_t>(out_.size());
            out_.emplace_back(empty());
            out_[at.to].child[at.slot] = to;
            add_children(at.from, to);
        }
        return std::move(out_);
    }

   private:
    struct Row {
        float cost[N];          // [k], k > 0: of the subtree as at most k children of a wide node
        uint32_t first, count;  // slots
        bool leaf;              // cheaper as a leaf than as a node
    };

    void fill(size_t i) {
        const BinaryNode& n = nodes_[i];
        Row& row = table_[i];
        const float area = half_area(n);
        const bool inner = n.count == 0;
        const Row& a = table_[inner ? n.left_or_first : i];
        const Row& b = table_[inner ? n.left_or_first + 1 : i];
        row.first = inner ? a.first : n.left_or_first;
        row.count = inner ? a.count + b.count : n.count;
        const uint32_t blocks = (row.count + walk_.block_size - 1) / walk_.block_size;
        const bool fits = row.count <= walk_.max_leaf;
        const float as_leaf = fits ? area * walk_.block * static_cast<float>(blocks)
                                   : std::numeric_limits<float>::infinity();
        row.leaf = true;
        if (!inner) {
            std::fill_n(row.cost, N, as_leaf);
            return;
        }
        const float as_node = area + spread_cost(a, b, N).first;
        row.leaf = fits && as_leaf <= as_node;
        row.cost[1] = std::min(as_leaf, as_node);
        for (uint32_t k = 2; k < N; ++k)
            row.cost[k] = std::min(row.cost[k - 1], spread_cost(a, b, k).first);
    }

    // Least cost of both subtrees as at most `slots` children together, and how many of them
    // are the first's.
    static std::pair<float, uint32_t> spread_cost(const Row& a, const Row& b, uint32_t slots) {
        std::pair<float, uint32_t> best{std::numeric_limits<float>::infinity(), 1};
        for (uint32_t k = 1; k < slots; ++k) {
            const float c = a.cost[k] + b.cost[slots - k];
            if (c < best.first) best = {c, k};
        }
        return best;
    }

    // The children that a node of `slots` places has, appended to `child`.
    void spread(uint32_t node, uint32_t slots, uint32_t* child, uint32_t& n) const {
        const uint32_t left = nodes_[node].left_or_first;
        const uint32_t k = spread_cost(table_[left], table_[left + 1], slots).second;
        place(left, k, child, n);
        place(left + 1, slots - k, child, n);
    }

    void place(uint32_t node, uint32_t slots, uint32_t* child, uint32_t& n) const {
        if constexpr (N > 2) {
            const Row& row = table_[node];
            while (slots > 1 && row.cost[slots - 1] == row.cost[slots]) --slots;
            if (slots > 1) return spread(node, slots, child, n);
        }
        child[n++] = node;
    }

    static WideNode<N> empty() {
        WideNode<N> w;
        for (int k = 0; k < 3; ++k) {
            std::fill_n(w.lo[k], N, std::numeric_limits<float>::infinity());
            std::fill_n(w.hi[k], N, -std::numeric_limits<float>::infinity());
        }
        std::fill_n(w.child, N, kEmptyChild);
        return w;
    }

    static void put_box(WideNode<N>& w, uint32_t slot, const BinaryNode& n) {
        for (int k = 0; k < 3; ++k) {
            w.lo[k][slot] = outward(n.lo[k], -1.0);
            w.hi[k][slot] = outward(n.hi[k], 1.0);
        }
    }

    // x + sign kBoxPad, rounded to that side.
    static float outward(float x, double sign) {
        const double y = x + sign * static_cast<double>(kBoxPad);
        return static_cast<float>(y + sign * 0x1p-23 * std::abs(y));
    }

    uint32_t leaf(uint32_t node) const {
        return kLeafFlag | table_[node].first << 4 | (table_[node].count - 1);
    }

    const std::vector<BinaryNode>& nodes_;
    WalkCost walk_;
    std::vector<Row> table_;
    std::vector<WideNode<N>> out_;
};

}  // namespace

template <uint32_t N>
std::vector<WideNode<N>> collapse(const BuiltBvh& bvh, const WalkCost& cost) {
    if (bvh.order.size() > 1u << 27)
        throw std::invalid_argument(std::to_string(bvh.order.size()) +
                                    " references; a tree holds at most 2^27");
    return Collapse<N>(bvh, cost).run();
}
template std::vector<WideNode<2>> collapse(const BuiltBvh&, const WalkCost&);
template std::vector<WideNode<4>> collapse(const BuiltBvh&, const WalkCost&);
template std::vector<WideNode<8>> collapse(const BuiltBvh&, const WalkCost&);

}  // namespace veriray
