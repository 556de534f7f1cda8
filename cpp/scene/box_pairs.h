// Pairs of overlapping boxes from two sets.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <numeric>
#include <vector>

#include "scene/scene.h"
#include "scene/thread_pool.h"

namespace veriray {

inline Double3 least(Double3 a, Double3 b) {
    return {std::min(a.x, b.x), std::min(a.y, b.y), std::min(a.z, b.z)};
}
inline Double3 most(Double3 a, Double3 b) {
    return {std::max(a.x, b.x), std::max(a.y, b.y), std::max(a.z, b.z)};
}

// Without branches, which would be unpredictable.
inline bool meet(const Box& a, const Box& b) {
    return (a.low.x <= b.high.x) & (a.low.y <= b.high.y) & (a.low.z <= b.high.z) &
           (b.low.x <= a.high.x) & (b.low.y <= a.high.y) & (b.low.z <= a.high.z);
}

// A tree of boxes, halved at the median along the longest axis of their centres.
class BoxTree {
   public:
    explicit BoxTree(std::vector<Box> boxes) : boxes_(std::move(boxes)), order_(boxes_.size()) {
        std::iota(order_.begin(), order_.end(), 0u);
        if (!order_.empty()) divide(0, static_cast<uint32_t>(order_.size()));
    }

    // Calls visit(i) for every box i that overlaps this one, until it returns false; then returns
    // false.
    template <class Visit>
    bool find(const Box& box, Visit visit) const {
        for (size_t k = 0; k < nodes_.size();) {
            const Node& node = nodes_[k];
            if (!meet(node.box, box)) {
                k = node.next;
                continue;
            }
            ++k;
            for (uint32_t i = node.first; i < node.end; ++i)
                if (meet(boxes_[order_[i]], box) && !visit(order_[i])) return false;
        }
        return true;
    }

   private:
    static constexpr uint32_t kLeaf = 4;
    // A node precedes its halves. next: the node after its subtree; first to end: of a leaf, in
    // order_.
    struct Node {
        Box box;
        uint32_t next, first, end;
    };

    void divide(uint32_t first, uint32_t end) {
        const size_t at = nodes_.size();
        nodes_.push_back({boxes_[order_[first]], 0, first, end});
        Box& all = nodes_[at].box;
        Double3 low = middle(order_[first]), high = low;
        for (uint32_t i = first; i < end; ++i) {
            const Box& b = boxes_[order_[i]];
            const Double3 m = middle(order_[i]);
            all = {least(all.low, b.low), most(all.high, b.high)};
            low = least(low, m), high = most(high, m);
        }
        if (end - first > kLeaf) {
            nodes_[at].end = first;
            const Double3 size = high - low;
            const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
            const uint32_t half = first + (end - first) / 2;
            std::nth_element(
                order_.begin() + first, order_.begin() + half, order_.begin() + end,
                [&](uint32_t a, uint32_t b) { return middle(a)[axis] < middle(b)[axis]; });
            divide(first, half);
            divide(half, end);
        }
        nodes_[at].next = static_cast<uint32_t>(nodes_.size());
    }

    Double3 middle(uint32_t i) const { return (boxes_[i].low + boxes_[i].high) * 0.5; }
    std::vector<Box> boxes_;
    std::vector<uint32_t> order_;
    std::vector<Node> nodes_;
};

// Calls visit(i, j) where box_a(i), i < n, overlaps box_b(j), j < m, until it returns false; then
// returns false. Uses a tree over the smaller set and all threads; the order is arbitrary.
template <class BoxA, class BoxB, class Visit>
bool box_pairs(size_t n, BoxA box_a, size_t m, BoxB box_b, Visit visit) {
    const bool swapped = m < n;
    std::vector<Box> boxes(std::min(n, m));
    for (size_t i = 0; i < boxes.size(); ++i) boxes[i] = swapped ? box_b(i) : box_a(i);
    const BoxTree tree(std::move(boxes));
    std::atomic<bool> goes_on(true);
    in_chunks(kAllThreads, std::min(n, m) ? std::max(n, m) : 0, [&](size_t first, size_t last) {
        for (size_t k = first; k < last && goes_on; ++k)
            if (!tree.find(swapped ? box_a(k) : box_b(k),
                           [&](size_t i) { return swapped ? visit(k, i) : visit(i, k); }))
                goes_on = false;
    });
    return goes_on;
}

}  // namespace veriray
