// The ledger's counts of a block of threads.
#pragma once

#include "core/platform.h"
#include "integrators/ledger.h"

namespace veriray {

inline constexpr uint32_t kLedgerRowsShared = 32;

// A block's counts of the ledger, in shared memory; deeper events go to device memory at once.
struct BlockLedger {
    uint32_t counts[kLedgerRowsShared * kLedgerColumns];

    __device__ void clear() {
        for (uint32_t i = threadIdx.x; i < kLedgerRowsShared * kLedgerColumns; i += blockDim.x)
            counts[i] = 0;
    }
    __device__ void record(uint64_t* ledger, uint32_t depth, uint32_t column) {
        if (depth < kLedgerRowsShared)
            atomicAdd(&counts[depth * kLedgerColumns + column], 1u);
        else
            atomic_add(ledger + static_cast<uint64_t>(depth) * kLedgerColumns + column, 1);
    }
    // After a barrier.
    __device__ void add_to(uint64_t* ledger) const {
        for (uint32_t i = threadIdx.x; i < kLedgerRowsShared * kLedgerColumns; i += blockDim.x)
            if (counts[i]) atomic_add(ledger + i, counts[i]);
    }
};

}  // namespace veriray
