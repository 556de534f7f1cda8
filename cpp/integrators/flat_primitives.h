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

    // Whether there is something to do for one of the features: code for lanes covers many scenes,
    // and what a scene does without is skipped.
    static VR_HD bool uses(const SceneView& scene, FeatureMask features) {
        return has(features) && (kOneLane || (scene.features & features) != 0);
    }

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
                [&](F t_max, F& t) VR_INLINED {
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
                    [&](F t_max, F& t) VR_INLINED {
                        return meets_flat<L, 4>(scene.polygons + i * kPolygonFloats, ray, t_max, t);
                    },
                    primitive + i);
            primitive += scene.polygon_count;
        }
        if constexpr (has(kDisks)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.disk_count; ++i)
                test(
                    [&](F t_max, F& t) VR_INLINED {
                        return meets_disk<L>(scene.disks + i * kDiskFloats, ray, t_max, t);
                    },
                    primitive + i);
            primitive += scene.disk_count;
        }
        if constexpr (has(kSpheres)) {
            VR_ROLLED
            for (uint32_t i = 0; i < scene.sphere_count; ++i)
                test(
                    [&](F t_max, F& t) VR_INLINED {
                        return meets_sphere<L>(scene.spheres + i * kSphereFloats, ray, last,
                                               U(primitive + i), t_max, t);
                    },
                    primitive + i);
        }
    }

    // The nearest hit beyond `last` and before t_max; t = t_max and primitive ~0 where there is
    // none.
    static VR_HD Hit<L> closest_flat(const SceneView& scene, const Ray<L>& ray, const Hit<L>& last,
                                     F t_max) {
        Hit<L> hit{t_max, U(~0u)};
        const auto look = [&]<bool kGoesOn>() VR_INLINED {
            each_flat(scene, ray, last, 0, [&](auto meets, uint32_t primitive) VR_INLINED {
                F t;
                M take = meets(hit.t, t);
                if constexpr (kGoesOn) take = take & beyond<L>(last, t, U(primitive));
                hit.t = select(take, t, hit.t);
                hit.primitive = select(take, U(primitive), hit.primitive);
            });
        };
        if (uses(scene, kGoOn))
            look.template operator()<has(kGoOn)>();
        else
            look.template operator()<false>();
        return hit;
    }

    // The first quad that shadow rays from `origin` can meet: from in front of a plane to in front
    // of it, none meets it.
    static VR_HD uint32_t first_blocker(const SceneView& scene, const Vec3<F>& origin, M wanted) {
        if constexpr (has(kQuads)) {
            M behind = wanted & !wanted;
            VR_ROLLED
            for (uint32_t i = 0; i < scene.first_occluder; ++i) {
                const auto record = quad(scene, i);
                const F height = height_over<L>(&record[0], origin);
                behind = behind | !(height > F(0.f));
            }
            if (none(behind & wanted)) return scene.first_occluder;
        }
        return 0;
    }

    // Those of the lanes `wanted` that meet a primitive other than `skip` before t_max.
    static VR_HD M occluded_flat(const SceneView& scene, const Ray<L>& ray, F t_max, M wanted,
                                 U skip) {
        M blocked = wanted & !wanted;
        uint32_t mark = 0;  // CUDA: a condition kept in a register costs two instructions more
        each_flat(scene, ray, nothing_met<L>(), first_blocker(scene, ray.o, wanted),
                  [&](auto meets, uint32_t primitive) VR_INLINED {
                      F t;
                      M hit = meets(t_max, t);
                      if constexpr (has(kSkippedLights)) hit = hit & !(skip == U(primitive));
                      if constexpr (kOneLane)
                          mark = hit ? 1u : mark;
                      else
                          blocked = blocked | hit;
                  });
        if constexpr (kOneLane) blocked = mark != 0;
        return blocked & wanted;
    }
};

// Those loops for all shapes, called by code for trees.
template <class L>
struct CalledFlat {
    using Flat = FlatPrimitives<L, kQuads | kPolygons | kDisks | kSpheres | kPass | kSkippedLights>;
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;

    VR_CALLED static Hit<L> closest(const SceneView& scene, const Ray<L>& ray, const Hit<L>& last,
                                    F t_max) {
        return Flat::closest_flat(scene, ray, last, t_max);
    }
    VR_CALLED static M occluded(const SceneView& scene, const Ray<L>& ray, F t_max, M wanted,
                                U skip) {
        return Flat::occluded_flat(scene, ray, t_max, wanted, skip);
    }
};

}  // namespace veriray
