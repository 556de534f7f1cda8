#include "integrators/called.h"

namespace veriray {

VR_CALLED_BY_STAGES(template, Scalar)
#ifndef VR_ONE_LANE
VR_CALLED_BY_STAGES(template, Simd)
VR_CALLED_PACKETS(template, Simd)
#endif

}  // namespace veriray
