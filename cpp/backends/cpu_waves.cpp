// The schedulers `thrust` and `wavefront` on the CPU, and single paths: one lane, kFewVariants of
// every integrator. A translation unit of its own, compiled with less effort than those of `fused`.
#include "backends/cpu_variant.h"
#include "backends/render.h"
#include "integrators/integrators.h"

namespace veriray {
namespace {

template <class Tracer>
void begin_all(const SceneView& scene, const Job& job, const Columns& paths, int32_t* indices,
               uint64_t first, uint32_t begin, uint32_t end) {
    for (uint32_t i = begin; i < end; ++i)
        thrust_begin<Tracer>(scene, job, paths, indices, first, i);
}

template <class Tracer>
void bounce_all(const SceneView& scene, const Job& job, const PathPool& pool,
                const PathIndices& indices, uint32_t depth, uint32_t begin, uint32_t end,
                uint64_t* row) {
    for (uint32_t k = begin; k < end; ++k) {
        const BounceOutcome out =
            thrust_bounce<Tracer>(scene, job, pool.paths, indices, pool.compaction, depth, k);
        if (out.cause != kLive) ++row[out.cause];
        if (out.shadow != kLive) ++row[out.shadow];
    }
}

template <class Tracer>
void wave_tile(const SceneView& scene, const Job& job, const Wave& wave, uint32_t tile,
               LedgerRows& ledger) {
    run_wave_tile<Tracer>(scene, job, wave, tile,
                          [&](uint32_t depth, uint32_t column) { ++ledger.row(depth)[column]; });
}

template <class Tracer>
void trace(const HostScene& host, const PathSettings& settings, uint32_t x, uint32_t y,
           uint32_t sample, std::vector<PathVertex>& out) {
    const SceneView view = sampled_view(host.view);
    typename Tracer::State path = Tracer::begin(view, settings, x, y, host.width, sample);
    bool alive = true;
    for (uint32_t depth = 0; alive; ++depth) {
        const Ray<Scalar> ray = path.ray;
        const Hit<Scalar> hit = Tracer::next_hit(view, path, kInfinity, true);
        PathVertex v{};
        v.depth = depth;
        const Spectrum<float> before = path.throughput;
        const Events<Scalar> e = bounce<Tracer>(view, settings, path, depth, true);
        alive = e.alive;
        static const char* const names[] = {"scattered", "escaped",   "emitter_end", "absorbed",
                                            "rr_killed", "depth_cut", "invalid"};
        v.event = names[cause_of(e)];
        v.shadow = e.visible ? 1 : e.occluded ? 0 : -1;
        v.primitive = -1;
        const bool met = !e.escaped && !e.collided;
        const Vec3<float> flown = path.ray.o - ray.o;
        v.t = met          ? static_cast<float>(hit.t * host.unit)
              : e.collided ? static_cast<float>(sqrt(dot(flown, flown)) * host.unit)
                           : kInfinity;
        const float o[3] = {ray.o.x, ray.o.y, ray.o.z}, d[3] = {ray.d.x, ray.d.y, ray.d.z};
        for (int k = 0; k < 3; ++k) {
            const double t = v.t < kInfinity ? static_cast<double>(v.t) / host.unit : 0;
            const double at = static_cast<double>(o[k]) + t * static_cast<double>(d[k]);
            v.position[k] = at * host.unit + host.centre[k];
            v.direction[k] = d[k];
            v.throughput[k] = before[k];
            v.radiance[k] = path.radiance[k];
        }
        if (met) {
            v.primitive = host.input_index[hit.primitive];
            const Surface<Scalar> at = Tracer::surface_at(view, ray, hit, true);
            v.normal[0] = at.ng.x, v.normal[1] = at.ng.y, v.normal[2] = at.ng.z;
        }
        out.push_back(v);
    }
}

template <class Tracer>
constexpr CpuWaves kWaves = {
    Tracer::columns(Tracer::kMask),
    Tracer::request_columns(Tracer::kMask),
    begin_all<Tracer>,
    bounce_all<Tracer>,
    wave_tile<Tracer>,
    trace<Tracer>,
};

}  // namespace

const CpuWaves& cpu_waves(uint32_t integrator, uint32_t index) {
    const CpuWaves* found = nullptr;
    with_variant<kFewVariants>(integrator, index, [&]<class Variant>() {
        found = &kWaves<Called<typename Variant::template Tracer<Scalar>>>;
    });
    return *found;
}

}  // namespace veriray
