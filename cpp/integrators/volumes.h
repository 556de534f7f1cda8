// Media with grids: the albedo at collisions, and flights and transmittance through uneven
// extinction. Flights are sampled by delta tracking (E. Woodcock et al. 1965): collisions at the
// largest extinction, each real with the share that is there. Transmittance is estimated by ratio
// tracking (J. Novak et al., "Residual Ratio Tracking", 2014). Both are unbiased; a step costs a
// look-up, and there are as many steps as mean free paths of the largest extinction on the way.
#pragma once

#include "core/mapping.h"
#include "integrators/path_state.h"
#include "textures/grid.h"

namespace veriray {

template <class L>
struct Volumes {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    // A ray in a grid's box: where it enters and how far it goes, and the same in the unit cube's
    // coordinates, from there.
    struct Passage {
        F enter, length;
        V from, step;
        typename Grids<L>::Grid grid;
    };
    static VR_HD Passage passage(const SceneView& scene, U row, V o, V d, F limit) {
        F enter(0.f), leave = limit;
        const V low = Grids<L>::columns(scene.grids, row, kGridLow),
                high = Grids<L>::columns(scene.grids, row, kGridHigh);
        const auto clip = [&](F below, F above, F at, F along) {
            const F a = (below - at) / along, b = (above - at) / along;
            enter = max(min(a, b), enter), leave = min(max(a, b), leave);
        };
        clip(low.x, high.x, o.x, d.x);
        clip(low.y, high.y, o.y, d.y);
        clip(low.z, high.z, o.z, d.z);
        return {enter, leave - enter, Grids<L>::local(scene.grids, row, fma(d, enter, o), 1.f),
                Grids<L>::local(scene.grids, row, d, 0.f), Grids<L>::grid(scene.grids, row)};
    }

    // The distance to the next collision, infinite if the ray leaves before; weighs the throughput
    // by channel. Which collisions are real is chosen for the throughput at hand, so that its sum
    // stays (P. Kutz et al., "Spectral and Decomposition Tracking", 2017).
    static VR_LONG F flight(const SceneView& scene, Passage p, F sigma, RandomStream<U> random,
                            S& throughput, bool chromatic, M active) {
        const F free_path = F(1.f) / sigma;
        F way(0.f), t(kInfinity);
        M flying = active & (p.length > F(0.f));
        while (any(flying)) {
            const Block<U> r = next_block(random, flying);
            way = fma(exponential(r.x), free_path, way);
            flying = flying & (way < p.length);
            if (none(flying)) break;
            const S there = Grids<L>::value(scene.grids, p.grid, fma(p.step, way, p.from), flying);
            F share = there[0];
            if (chromatic) share = inner(shares(throughput), there);
            const M collides = flying & below(r.y, r.z, share);
            if (chromatic) {
                const F rest = F(1.f) - share;
                const S weight = S::of([&](uint32_t k) {
                    return select(collides, there[k], F(1.f) - there[k]) /
                           select(collides, share, rest);
                });
                throughput = select(flying, throughput * weight, throughput);
            }
            t = select(collides, p.enter + way, t);
            flying = flying & !collides;
            // Chances of 1 less a rounding leave nothing.
            if (chromatic) flying = flying & (max_channel(throughput) > F(0.f));
        }
        return t;
    }

    // An estimate of the transmittance. Below a quarter, roulette ends half of the rays.
    static VR_LONG S transmittance(const SceneView& scene, Passage p, F sigma,
                                   RandomStream<U>& random, M active) {
        const F free_path = F(1.f) / sigma;
        F way(0.f);
        S through = S::all(F(1.f));
        M flying = active & (p.length > F(0.f));
        while (any(flying)) {
            const Block<U> r = next_block(random, flying);
            way = fma(exponential(r.x), free_path, way);
            flying = flying & (way < p.length);
            if (none(flying)) break;
            const S there = Grids<L>::value(scene.grids, p.grid, fma(p.step, way, p.from), flying);
            const S rest = S::of([&](uint32_t k) { return F(1.f) - there[k]; });
            through = select(flying, through * rest, through);
            const M plays = flying & (max_channel(through) < F(0.25f));
            const M survives = plays & (uniform(r.y) < F(0.5f));
            through = select(survives, through * F(2.f), through);
            through = select(plays & !survives, S::all(F(0.f)), through);
            flying = flying & (max_channel(through) > F(0.f));
        }
        return through;
    }

   private:
    // True with probability x in [0, 1]: compares 48 bits, so that small ones count.
    static VR_HD M below(U upper, U lower, F x) {
        const F scaled = x * F(0x1p24f), whole = floor(scaled), u = to_float(upper >> 8);
        return (u < whole) | ((u == whole) & (uniform(lower) < scaled - whole));
    }
};

}  // namespace veriray
