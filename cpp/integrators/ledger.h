// The ray ledger: how every segment ended, as integers that add up exactly.
//   live[d] = escaped + emitter_end + absorbed + rr_killed + depth_cut + invalid + live[d + 1]
// d counts segments from the camera's, 0. At most one shadow ray leaves each vertex.
#pragma once

#include <cstdint>

namespace veriray {

enum LedgerColumn : uint32_t {
    kLive,
    kEscaped,     // met nothing
    kEmitterEnd,  // met the front of an emitter that reflects nothing
    kAbsorbed,    // met a black surface, or the back of a one-sided one
    kRrKilled,    // ended by roulette at this vertex
    kDepthCut,    // may not scatter here: max_depth
    kInvalid,     // the path's sample was refused by the film
    kShadowVisible,
    kShadowOccluded,
    kLedgerColumns,
};

// Paths are cut here whatever max_depth is, and counted as depth_cut.
inline constexpr uint32_t kHardMaxDepth = 262143;

}  // namespace veriray
