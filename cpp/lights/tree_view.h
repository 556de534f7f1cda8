// The records of a light tree.
#pragma once

#include "core/lane.h"

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

// The columns of a branch up to its strength, by lane.
template <class F>
struct BranchRecord {
    F columns[3][4];

    template <class U>
    VR_HD BranchRecord(const float* branches, U at) {
        static_assert(kBranchStrength == 11 && kBranchFloats % 4 == 0);
        for (uint32_t k = 0; k < 3; ++k) gather4(branches + 4 * k, at, columns[k]);
    }
    VR_HD F operator()(uint32_t c) const { return columns[c / 4][c % 4]; }
};

}  // namespace veriray
