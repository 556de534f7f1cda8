// One compiled variant, VR_VARIANT, of every integrator for scheduler `fused` on the CPU.
#include "backends/cpu_variant.h"

#include "integrators/integrators.h"

namespace veriray {
namespace {

// Full lanes; where these are one, what the other schedulers call (cpu_waves.cpp). The variants
// with everything that is rich have stages that are called: GCC compiles them in half the time, and
// they are as fast within 2 %.
template <class Variant, class Tracer = typename Variant::template Tracer<Simd>>
using Lanes = std::conditional_t<Simd::kWidth == 1 || (kVariants[VR_VARIANT] & kTangents) != 0,
                                 Called<Tracer>, Tracer>;

template <class Tracer>
void tile(Tile& tile, const SceneView& scene, const Job& job, uint32_t pixel, uint32_t pixels,
          uint32_t sample, uint32_t samples, LedgerRows& ledger) {
    tile.run<Tracer>(scene, job, pixel, pixels, sample, samples, ledger);
}

template <class Variant>
constexpr CpuVariant kVariant = {Lanes<Variant>::columns(Lanes<Variant>::kMask),
                                 tile<Lanes<Variant>>};

}  // namespace

template <>
const CpuVariant& cpu_variant_at<VR_VARIANT>(uint32_t integrator) {
    const CpuVariant* found = nullptr;
    with_integrator<VR_VARIANT>(integrator, [&]<class Variant>() { found = &kVariant<Variant>; });
    return *found;
}

}  // namespace veriray
