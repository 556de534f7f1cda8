// Kernels that were compiled at run time for exactly a set of features.
#pragma once

#include "api/renderer.h"

namespace veriray {

// The launches of scheduler `wavefront`; features: what they were compiled for. scatter: of one
// kind of material, where hits are shaded by kind.
struct WaveKernels {
    FeatureMask features = 0;
    const void *refill = nullptr, *trace = nullptr, *shadow = nullptr, *scatter_all = nullptr;
    const void* scatter[kMaterialCount] = {};
};

// For these features on this device; null: none were added. Valid as long as the process.
const void* fused_kernel_for(int device, FeatureMask features);
const WaveKernels* wave_kernels_for(int device, FeatureMask features);

}  // namespace veriray
