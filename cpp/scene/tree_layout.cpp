#include "scene/tree_layout.h"

#include <stdexcept>

namespace veriray {

std::vector<RecordBlock> pack_blocks(std::vector<WideNode<kCpuWidth>>& nodes,
                                     const std::vector<float>& records) {
    std::vector<RecordBlock> blocks;
    for (WideNode<kCpuWidth>& node : nodes)
        for (uint32_t& child : node.child) {
            if (child == kEmptyChild || !(child & kLeafFlag)) continue;
            const uint32_t first = (child & ~kLeafFlag) >> 4, count = (child & 15u) + 1;
            const size_t at = blocks.size(), more = (count + kBlock - 1) / kBlock;
            if (at + more > 1u << 27) throw std::invalid_argument("more than 2^27 leaf blocks");
            blocks.resize(at + more);  // zeros
            for (uint32_t i = 0; i < count; ++i)
                for (uint32_t c = 0; c < kRecordFloats; ++c)
                    blocks[at + i / kBlock].rows[c][i % kBlock] =
                        records[static_cast<size_t>(first + i) * kRecordFloats + c];
            child = kLeafFlag | static_cast<uint32_t>(at) << 4 | static_cast<uint32_t>(more - 1);
        }
    return blocks;
}

}  // namespace veriray
