// The kernels of a scheduler for exactly the features of a scene, compiled at run time
// (kernels.py): for integrator VR_INTEGRATOR of the list and the mask VR_FEATURES, with
// VR_WAVEFRONT those of `wavefront`, else `fused`.
#include "integrators/integrators.h"

namespace veriray {

using RunTimeTracer = IntegratorAt<VR_INTEGRATOR>::Tracer<Scalar, VR_FEATURES>;

}  // namespace veriray

#ifdef VR_WAVEFRONT
#include "backends/wavefront_kernels.cuh"

namespace veriray {

extern "C" {

__global__ void __launch_bounds__(kWaveBlock)
    veriray_refill(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                   const __grid_constant__ Wave w) {
    block_refills<RunTimeTracer>(scene, job, w);
}
__global__ void __launch_bounds__(kWaveBlock)
    veriray_trace(const __grid_constant__ SceneView scene, const __grid_constant__ Wave w) {
    block_traces<RunTimeTracer, true>(scene, w);
}
__global__ void __launch_bounds__(kWaveBlock)
    veriray_shadow(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                   const __grid_constant__ Wave w, uint64_t* ledger) {
    block_shadows<RunTimeTracer, true>(scene, job, w, ledger);
}

__global__ void __launch_bounds__(kWaveBlock)
    veriray_scatter(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                    const __grid_constant__ Wave w, uint32_t kind, bool misses, uint64_t* ledger) {
    if constexpr (!by_kind(VR_FEATURES, kHitKinds))
        block_scatters<RunTimeTracer>(scene, job, w, kind, misses, ledger);
}

// Likewise, of one kind of material each; empty where the scene has none of it or one launch does
// all.
#define VR_SCATTER(name)                                                                \
    __global__ void __launch_bounds__(kWaveBlock) veriray_scatter_##name(               \
        const __grid_constant__ SceneView scene, const __grid_constant__ Job job,       \
        const __grid_constant__ Wave w, uint32_t kind, bool misses, uint64_t* ledger) { \
        if constexpr (by_kind(VR_FEATURES, kHitKinds) &&                                \
                      ((VR_FEATURES) & materials(kind_bit(kKind##name))) != 0)          \
            block_scatters<OneKind<RunTimeTracer, kKind##name>, RunTimeTracer>(         \
                scene, job, w, kind, misses, ledger);                                   \
    }
VR_CLOSURES(VR_SCATTER)
#undef VR_SCATTER

}  // extern "C"

}  // namespace veriray
#else
#include "backends/fused_kernel.cuh"

namespace veriray {

extern "C" __global__ void __launch_bounds__(kFusedBlock, kFusedBlocks<VR_FEATURES>)
    veriray_fused(const __grid_constant__ SceneView scene, const __grid_constant__ Job job,
                  const FusedItems items, Control* control, uint64_t* ledger) {
    trace_fused<RunTimeTracer, true>(scene, job, items, control, ledger);
}

}  // namespace veriray
#endif
