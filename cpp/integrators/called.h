// Long functions that the stages call. On the host they are compiled once for each instruction set
// (called.cpp) instead of once in each compiled variant.
#pragma once

#include "lights/tree.h"
#include "textures/texture.h"

#define VR_CALLED_BY_STAGES(X, L) \
    X struct LightTree<L>;        \
    X struct Textures<L, false>;  \
    X struct Textures<L, true>;

#if !VR_CUDA
namespace veriray {

VR_CALLED_BY_STAGES(extern template, Scalar)
#ifndef VR_ONE_LANE
VR_CALLED_BY_STAGES(extern template, Simd)
#endif

}  // namespace veriray
#endif
