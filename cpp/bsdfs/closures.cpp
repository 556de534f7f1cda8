// What the host asks of closures.
#include "bsdfs/closures.h"

namespace veriray {

const ClosureTraits& closure_traits(uint32_t kind) { return kClosures[kind]; }

}  // namespace veriray
