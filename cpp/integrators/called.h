// Long functions that the stages call. On the host they are compiled once for each instruction set
// (called.cpp) instead of once in each compiled variant.
#pragma once

#include "geometry/bvh.h"
#include "integrators/flat_primitives.h"
#include "lights/tree.h"
#include "textures/texture.h"

#define VR_CALLED_WALKS(X, L, kinds)                                              \
    X void walk_in_order<kinds, false, L>(const BvhView&, Walkers<L>&, uint32_t); \
    X void walk_in_order<kinds, true, L>(const BvhView&, Walkers<L>&, uint32_t);  \
    X void walk_in_turns<kinds, false, L>(const BvhView&, Walkers<L>&, uint32_t); \
    X void walk_in_turns<kinds, true, L>(const BvhView&, Walkers<L>&, uint32_t);

#define VR_CALLED_PACKETS(X, L)                                                   \
    X void walk_together<kTreeTriangles, L>(const BvhView&, Packet<L>&, Hit<L>&); \
    X void walk_together<kTreeAll, L>(const BvhView&, Packet<L>&, Hit<L>&);

#define VR_CALLED_BY_STAGES(X, L)         \
    VR_CALLED_WALKS(X, L, kTreeTriangles) \
    VR_CALLED_WALKS(X, L, kTreeAll)       \
    X struct CalledFlat<L>;               \
    X struct LightTree<L>;                \
    X struct Textures<L, false>;          \
    X struct Textures<L, true>;

#if !VR_CUDA
namespace veriray {

VR_CALLED_BY_STAGES(extern template, Scalar)
#ifndef VR_ONE_LANE
VR_CALLED_BY_STAGES(extern template, Simd)
VR_CALLED_PACKETS(extern template, Simd)
#endif

}  // namespace veriray
#endif
