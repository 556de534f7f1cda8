// Trees as the walks of geometry/bvh.h read them.
#pragma once

#include <vector>

#include "geometry/bvh.h"

namespace veriray {

// Asks for large pages, where the system has them, for memory that was not touched yet.
void use_large_pages(const void* memory, size_t bytes);

// The CPU's leaves from records by primitive (kRecordFloats each); order: primitives by slot. The
// leaves of `nodes` then
// begin at blocks, not at slots. Throws std::invalid_argument for a leaf of more than kCpuLeaf
// records and for more than 2^27 blocks.
std::vector<RecordBlock> pack_blocks(std::vector<WideNode<kCpuWidth>>& nodes,
                                     const std::vector<uint32_t>& order,
                                     const std::vector<float>& records);

}  // namespace veriray
