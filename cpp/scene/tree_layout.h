// Trees in the layout that the traversals of geometry/bvh.h read.
#pragma once

#include <vector>

#include "geometry/bvh.h"
#include "scene/large.h"

namespace veriray {

// Packs the CPU's leaves from records by primitive (kRecordFloats each); order: primitives by slot.
// Afterwards the leaves of `nodes` begin at blocks, not at slots. Throws std::invalid_argument for
// a leaf of more than N records and for more than 2^27 blocks.
template <uint32_t N>
Large<RecordBlock> pack_blocks(std::vector<WideNode<N>>& nodes, const std::vector<uint32_t>& order,
                               const float* records);

}  // namespace veriray
