#include "integrators/called.h"

namespace veriray {

VR_CALLED_BY_STAGES(template, Scalar)
#ifndef VR_ONE_LANE
VR_CALLED_BY_STAGES(template, Simd)
#endif

}  // namespace veriray
