// Walks of a warp through the tree in step: the scheduler `fused` for CUDA and scenes with a tree,
// and `walk_queue`, by which `wavefront` traces there. Rays of a warp take walks of very different
// length, so a lane that has arrived does not wait for the last: the walk stops when most of the
// warp have arrived, those set out again, and all walk on. In `fused` they shade first, and set out
// by a shadow ray or the next one; in `walk_queue` they take the next rays of a queue. T. Aila and
// S. Laine, "Understanding the efficiency of ray traversal on GPUs", 2009.
#pragma once

#include "schedulers/fused.h"

namespace veriray {

// The walk stops when at most kStayPart eighths of the lanes are on their way, and tests leaves
// when at most kNodePart eighths of those are at nodes. kFollowers lanes whose shadow rays have
// arrived make the warp start their next rays. By measurement (H200, twelve scenes of meshes,
// spheres and many lamps).
inline constexpr uint32_t kStayPart = 1, kNodePart = 3, kFollowers = 4;

// Features whose code takes more registers than kWalkBlocks leave, without many kinds of material.
inline constexpr FeatureMask kWide = kTangents | kBlend | kAttributes | kUnevenMedia |
                                     kAlbedoGrids | kPhases | kLightTextures | kHidden;
// Walks wait for memory and for instructions, so where little is spilled, kernels are compiled for
// this number of blocks of 128 threads a multiprocessor (80 registers of compute capability 9.0).
inline constexpr uint32_t kWalkBlocks = 6;
// Without a tree and media (102 registers).
inline constexpr uint32_t kFlatBlocks = 5;
constexpr bool few_kinds(uint32_t kinds) {
    kinds &= kinds - 1, kinds &= kinds - 1, kinds &= kinds - 1;
    return (kinds & (kinds - 1)) == 0;  // four at most
}
template <FeatureMask kMask>
inline constexpr bool kSlim = (kMask & kBvh) && !(kMask & kWide) && few_kinds(kinds_of(kMask));

// The lanes of a warp walk until at most `enough` are on their way; on_way: how many are. Between
// steps, between() may send lanes on their way that have arrived.
template <class Tracer, class Between>
VR_HD void walk_on(const SceneView& scene, const RayFrame& f, const WalkAim& look, uint32_t on_way,
                   uint32_t enough, Hit<Scalar>& hit, WalkPlace<kDeviceWidth>& place,
                   Between between) {
    while (on_way > enough) {
        do {
            if (place.at_node()) walk_node(scene.bvh, f.slabs, look.last.t, hit.t, place);
        } while (8 * lanes_with(place.at_node()) > kNodePart * on_way);
        if (place.at_leaf())
            walk_leaf<kDeviceWidth, Tracer::kTreeKinds>(scene.bvh, f, look, hit, place);
        between();
        on_way = lanes_with(place.walking());
    }
}

// As run_fused, in step.
template <class Tracer, class Take, class Add, class Record>
VR_HD void run_walking(const SceneView& scene, const Job& job, const FusedItems& items,
                       PixelSum& sum, Take take, Add add, Record record) {
    enum class Aim : uint32_t { kNone, kNext, kLight };  // of a lane's walk
    FusedLane lane;
    typename Tracer::State path{};
    Spectrum<float> sample{};
    typename Tracer::Request shadow{};
    LedgerColumn cause = kEscaped;  // of the path's end; kLive: it goes on after its shadow ray
    uint32_t depth = 0;
    Aim aim = Aim::kNone;
    Hit<Scalar> hit{kInfinity, ~0u};
    WalkPlace<kDeviceWidth> place;
    place.node = kWalkEnd;
    const bool through = Tracer::shadows_pass(scene);
    // What the walk is after, and the ray's numbers for it.
    WalkAim look;
    RayFrame f;
    const auto set_out = [&] {
        const bool light = aim == Aim::kLight;
        look = {light && !through, light ? shadow.skip : ~0u,
                light ? Tracer::passed(shadow) : Tracer::passed(path)};
        f = frame_of(scene.bvh, light ? shadow.ray : path.ray);
    };
    for (;;) {
        // Those that have arrived shade.
        bool arrived = !place.walking();
        if constexpr (Tracer::has(kPass))
            if (arrived && aim != Aim::kNone && (scene.features & kGoOn)) {
                const bool light = aim == Aim::kLight;
                uint32_t& passed = light ? shadow.passed : path.passed;
                const Hit<Scalar> last{light ? shadow.travelled : path.travelled, passed};
                if (Tracer::same_sheet(scene, light ? shadow.ray : path.ray, last, hit, true)) {
                    passed = hit.primitive;
                    hit = {light ? shadow.t_max : kInfinity, ~0u};
                    place.begin();
                    arrived = false;
                }
            }
        bool to_light = false;
        if (arrived && aim == Aim::kNext) {
            const Events<Scalar> e =
                Tracer::scatter(scene, job.settings, path, hit, depth, true, shadow);
            cause = cause_of(e);
            if (e.occluded) record(depth, kShadowOccluded);
            to_light = shadow.wanted;
        } else if (arrived && aim == Aim::kLight) {
            bool free;
            if (through) {
                to_light = true;
                free = Tracer::shadow_hit(scene, shadow, hit, to_light);
            } else {
                free = !(hit.t < shadow.t_max);
                if constexpr (Tracer::has(kMedia))
                    Tracer::attenuate(scene, shadow, shadow.t_max, free);
            }
            if (!to_light) record(depth, free ? kShadowVisible : kShadowOccluded);
            Tracer::visible(path, shadow, free);
        }
        // Those whose bounce is complete begin the next one, or the next path.
        const bool complete = arrived && !to_light, ended = complete && cause != kLive;
        const bool done = ended && aim != Aim::kNone;
        if (done) {
            record(depth, finish<Tracer>(scene, job, path, cause, sample));
            ++lane.sample;
        }
        add(done, sample);
        if (!lane.serve(job, items, ended, take, sum)) return;
        const bool idle = lane.idle();
        if (complete) {
            aim = idle ? Aim::kNone : Aim::kNext;
            depth = ended ? 0 : depth + 1;
            if (ended && !idle) path = lane.template begin<Tracer>(scene, job);
        }
        if (to_light) aim = Aim::kLight;
        if (arrived) hit = {aim == Aim::kLight ? shadow.t_max : kInfinity, ~0u};
        if (arrived && !idle) place.begin();
        rejoin_warp();
        // All walk.
        set_out();
        const uint32_t enough = lanes_with(!idle) * kStayPart / 8;
        walk_on<Tracer>(scene, f, look, lanes_with(place.walking()), enough, hit, place, [&] {
            if constexpr (kSlim<Tracer::kMask> && !Tracer::has(kPass | kMedia)) {
                // Shadow rays that have arrived are followed by the next rays: lanes come to shade
                // once a bounce.
                const bool lit = aim == Aim::kLight && cause == kLive && !place.walking();
                if (lanes_with(lit) >= kFollowers && lit) {
                    const bool free = !(hit.t < shadow.t_max);
                    record(depth, free ? kShadowVisible : kShadowOccluded);
                    Tracer::visible(path, shadow, free);
                    ++depth;
                    aim = Aim::kNext;
                    hit = {kInfinity, ~0u};
                    set_out();
                    place.begin();
                }
            }
        });
    }
}

// A ray, what it looks for and what it has met so far.
struct WalkTask {
    Ray<Scalar> ray;
    WalkAim look;
    Hit<Scalar> hit;
};

// The rays of a queue. Lanes that have arrived take the next rays once kIdle of a warp wait.
// queue.take(wants) gives each lane that wants one a ray's place, or kNoPlace; queue.more(): some
// may be left; all lanes call both. start(k, task) gives the ray at place k; arrive(k, task) takes
// what it has met, and is true where it sets the ray out again.
inline constexpr uint32_t kIdle = 16, kNoPlace = ~0u;
template <class Tracer, class Queue, class Start, class Arrive>
VR_HD void walk_queue(const SceneView& scene, Queue queue, Start start, Arrive arrive) {
    WalkPlace<kDeviceWidth> place;
    place.node = kWalkEnd;
    WalkTask task;
    RayFrame f;
    uint32_t k = kNoPlace;
    for (;;) {
        bool on = !place.walking() && k != kNoPlace && arrive(k, task);
        rejoin_warp();
        const bool wants = !place.walking() && !on;
        const uint32_t next = queue.take(wants);
        if (wants) {
            k = next;
            on = k != kNoPlace;
            if (on) start(k, task);
        }
        if (on) {
            f = frame_of(scene.bvh, task.ray);
            place.begin();
        }
        rejoin_warp();
        const uint32_t on_way = lanes_with(place.walking());
        if (on_way == 0) return;
        const bool all = !queue.more() || on_way <= kIdle;
        walk_on<Tracer>(scene, f, task.look, on_way, all ? 0 : on_way - kIdle, task.hit, place,
                        [] {});
    }
}

}  // namespace veriray
