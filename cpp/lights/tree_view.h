// The records of a light tree.
#pragma once

#include <cstdint>

namespace veriray {

inline constexpr uint32_t kMostBranches = 16;  // of a node
// Cosines are widened by this, which is more than the rounding of cosines, of their square roots
// near an angle of 0 and of normals: a light that can give something has a chance.
inline constexpr float kAngleSlack = 0x1p-10f;

// A branch: one light, or a node with branches of its own, which stand together. Its lights lie in
// a ball, and emit in directions up to an angle, `wide`, from an axis and, less and less, up to
// another angle, `edge`, beyond that. All cosines.
enum BranchColumn : uint32_t {
    kBranchP,                       // centre; of light from far away the way to it
    kBranchRadius = kBranchP + 3,   // or kFarAway...
    kBranchAxis,                    // unit: 3 columns
    kBranchWide = kBranchAxis + 3,  // and its sine
    kBranchWideSine,
    kBranchEdge,
    kBranchInverse,   // 1 / (1 - edge)
    kBranchStrength,  // irradiance times the squared distance; from far away the irradiance
    kBranchFirst,     // bits: the first branch of the node, or the light's row
    kBranchCount,     // bits: how many branches; 0: a light
    kBranchUp,        // bits: the branch that is its node; ~0 at the root
    kBranchFloats = kBranchUp + 2,
};
// Radii that are none: light from one direction; from all, or one of several.
inline constexpr float kFromFar = -1.f, kFarOff = -1.5f, kFromAllAround = -2.f;

struct LightTreeView {
    const float* branches;  // [branch][kBranchFloats]; those of the root come first
    uint32_t root;          // how many
};

}  // namespace veriray
