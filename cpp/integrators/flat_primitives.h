// The primitives of scenes without a tree, one after another.
#pragma once

#include <type_traits>

#include "integrators/path_state.h"

namespace veriray {

#if VR_CUDA
// A block's copy of the scene's quads: a record takes three loads here, seven from the constant
// bank, which was a tenth of the Cornell box's time (H200). Kernels that trace fill it first, and
// wait for each other.
__device__ inline QuadRecord* block_quads() {
    __shared__ QuadRecord copy[kMaxFlat];
    return copy;
}

template <FeatureMask kFeatures>
__device__ void fill_block_quads(const SceneView& scene) {
    if constexpr ((kFeatures & kQuads) != 0) {
        float* const copy = block_quads()->v;
        for (uint32_t i = threadIdx.x; i < scene.quad_count * kQuadFloats; i += blockDim.x)
            copy[i] = scene.quads[i];
    }
}
#endif

template <class L, FeatureMask kFeatures>
struct FlatPrimitives {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;

    static constexpr bool has(FeatureMask features) { return (kFeatures & features) != 0; }
    static constexpr bool kOneLane = std::is_same_v<F, float>;

    // The record of quad i: on a CPU laid out for lanes, on CUDA from the block's copy.
    static VR_HD auto quad(const SceneView& scene, uint32_t i) {
        if constexpr (!kOneLane) {
            return static_cast<const typename L::Uniform*>(scene.uniform_quads) + i * kQuadFloats;
        } else {
#if VR_DEVICE_CODE
            return block_quads()[i];
#else
            QuadRecord record;
            memcpy(record.v, scene.quads + i * kQuadFloats, sizeof record.v);
            return record;
#endif
        }
    }

    // Tests the quads of a run from i on.
    template <uint32_t kWay, class Test>
    static VR_HD void each_of_run(const SceneView& scene, const Ray<L>& ray, uint32_t i,
                                  uint32_t end, Test test) {
        VR_ROLLED
        for (; i < end; ++i)
            test(
                [&](F t_max, F& t) {
                    if constexpr (kWay == kAnyWay) {
                        const auto record = quad(scene, i);
                        return meets_flat<L, 2>(&record[0], ray, t_max, t);
                    } else
                        return meets_short<L, kWay>(
                            static_cast<const typename L::Uniform*>(scene.uniform_shorts) +
                                i * kShortFloats,
                            ray, t_max, t);
                },
                i);
    }

    // Quads from i on, run by run. With one lane the runs of a box are too short to pay.
    template <class Test>
    static VR_HD void each_quad_by_runs(const SceneView& scene, const Ray<L>& ray, uint32_t i,
                                        Test test) {
        for (uint32_t k = 0; k < scene.run_count; ++k) {
            const QuadRun run = scene.runs[k];
            if (run.end <= i) continue;
            switch (run.way) {
                case 0:
                    each_of_run<0>(scene, ray, i, run.end, test);
                    break;
                case 1:
                    each_of_run<1>(scene, ray, i, run.end, test);
                    break;
                case 2:
                    each_of_run<2>(scene, ray, i, run.end, test);
                    break;
                case kAlong:
                    each_of_run<kAlong>(scene, ray, i, run.end, test);
                    break;
                case kAlong + 1:
                    each_of_run<kAlong + 1>(scene, ray, i, run.end, test);
                    break;
                case kAlong + 2:
                    each_of_run<kAlong + 2>(scene, ray, i, run.end, test);
                    break;
                default:
                    each_of_run<kAnyWay>(scene, ray, i, run.end, test);
            }
            i = run.end;
        }
    }

    // Calls test(meets, primitive) for every primitive from `first` (a quad) on of a scene without
    // a tree in ascending order; meets(t_max, t) tells whether the ray meets it at 0 < t < t_max,
    // where first, and a sphere beyond `last`.
    // On CUDA a block's copy of the quads must have been filled.
    template <class Test>
    static VR_HD void each_flat(const SceneView& scene, const Ray<L>& ray, const Hit<L>& last,
                                uint32_t first, Test test) {
        uint32_t primitive = 0;
        if constexpr (has(kQuads)) {
            if constexpr (kOneLane)
                each_of_run<kAnyWay>(scene, ray, first, scene.quad_count, test);
            else
                each_quad_by_runs(scene, ray, first, test);
            primitive = scene.quad_count;
        }
        if constexpr (has(kPolygons)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.polygon_count; ++i)
                test(
                    [&](F t_max, F& t) {
                        return meets_flat<L, 4>(scene.polygons + i * kPolygonFloats, ray, t_max, t);
                    },
                    primitive + i);
            primitive += scene.polygon_count;
        }
        if constexpr (has(kDisks)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.disk_count; ++i)
                test(
                    [&](F t_max, F& t) {
                        return meets_disk<L>(scene.disks + i * kDiskFloats, ray, t_max, t);
                    },
                    primitive + i);
            primitive += scene.disk_count;
        }
        if constexpr (has(kSpheres)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.sphere_count; ++i)
                test(
                    [&](F t_max, F& t) {
                        return meets_sphere<L>(scene.spheres + i * kSphereFloats, ray, last,
                                               U(primitive + i), t_max, t);
                    },
                    primitive + i);
        }
    }
};

}  // namespace veriray
