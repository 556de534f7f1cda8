// Trees as the walks of geometry/bvh.h read them.
#pragma once

#include <vector>

#include "geometry/bvh.h"

namespace veriray {

// The CPU's leaves from records in slot order (kRecordFloats each); the leaves of `nodes`, which
// count records, then count blocks. Throws std::invalid_argument for more than 2^27 blocks.
std::vector<RecordBlock> pack_blocks(std::vector<WideNode<kCpuWidth>>& nodes,
                                     const std::vector<float>& records);

}  // namespace veriray
