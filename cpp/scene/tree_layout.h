// Trees in the layout that the traversals of geometry/bvh.h read.
#pragma once

#include <vector>

#include "geometry/bvh.h"

namespace veriray {

// Requests large pages, if the system has them, for memory that has not been touched yet.
void use_large_pages(const void* memory, size_t bytes);

// Packs the CPU's leaves from records by primitive (kRecordFloats each); order: primitives by slot.
// Afterwards the leaves of `nodes` begin at blocks, not at slots. Throws std::invalid_argument for
// a leaf of more than kCpuLeaf records and for more than 2^27 blocks.
std::vector<RecordBlock> pack_blocks(std::vector<WideNode<kCpuWidth>>& nodes,
                                     const std::vector<uint32_t>& order,
                                     const std::vector<float>& records);

}  // namespace veriray
