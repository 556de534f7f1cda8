#include "scene/tree_layout.h"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "scene/thread_pool.h"

namespace veriray {
namespace {

// An empty vector with room for n, on large pages: with small pages, incoherent rays would miss the
// translation buffer at every step.
template <class T>
std::vector<T> room_for(size_t n) {
    std::vector<T> v;
    v.reserve(n);
    use_large_pages(v.data(), n * sizeof(T));
    return v;
}

size_t blocks_for(uint32_t count) { return (count * kLeafRows + kBlockFloats - 1) / kBlockFloats; }

template <uint32_t N, class Fn>
void each_leaf(WideNode<N>& node, Fn fn) {
    for (uint32_t& child : node.child)
        if (child != kEmptyChild && child & kLeafFlag) fn(child, (child & 15u) + 1);
}

}  // namespace

template <uint32_t N>
Large<RecordBlock> pack_blocks(std::vector<WideNode<N>>& nodes, const std::vector<uint32_t>& order,
                               const float* records) {
    size_t need = 0;
    std::vector<size_t> begin(nodes.size());  // of a node's leaves
    for (size_t i = 0; i < nodes.size(); ++i) {
        begin[i] = need;
        each_leaf(nodes[i], [&](uint32_t, uint32_t count) {
            if (count > N)
                throw std::invalid_argument("a leaf of more than " + std::to_string(N) +
                                            " records");
            need += blocks_for(count);
        });
    }
    if (need > 1u << 27) throw std::invalid_argument("more than 2^27 blocks of records");
    auto own = room_for<WideNode<N>>(nodes.size());
    own.assign(nodes.begin(), nodes.end());
    nodes.swap(own);
    need += N * sizeof(float) / sizeof(RecordBlock) + 1;  // vectors read past the last row
    Large<RecordBlock> blocks(need);
    const auto pack = [&](WideNode<N>& node, size_t at) {
        each_leaf(node, [&](uint32_t& child, uint32_t count) {
            const size_t first = (child & ~kLeafFlag) >> 4;
            float* rows = blocks[at].f;
            for (uint32_t i = 0; i < count; ++i) {
                const float* record = &records[size_t{order[first + i]} * kRecordFloats];
                for (uint32_t r = 0; r < kRecordId; ++r) rows[r * count + i] = record[r];
                rows[kRecordId * count + i] =
                    as_float(kRecordMark | as_uint(record[kRecordKind]) << kRecordKindShift |
                             as_uint(record[kRecordId]));
            }
            child = kLeafFlag | static_cast<uint32_t>(at) << 4 | (count - 1);
            at += blocks_for(count);
        });
    };
    in_chunks(kAllThreads, nodes.size(), [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i) pack(nodes[i], begin[i]);
    });
    return blocks;
}
template Large<RecordBlock> pack_blocks(std::vector<WideNode<8>>&, const std::vector<uint32_t>&,
                                        const float*);
template Large<RecordBlock> pack_blocks(std::vector<WideNode<16>>&, const std::vector<uint32_t>&,
                                        const float*);

}  // namespace veriray
