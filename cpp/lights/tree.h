// The choice of a light by where the receiver is. Lights are the leaves of a tree whose nodes have
// up to kMostBranches branches; scenes of few lights have the root alone. From the root on, a
// branch is chosen in proportion to a bound on what it can give to the receiver without blockers.
// The shares are multiples of 2^-24 that add up to 1. A. Conty Estevez, C. Kulla, "Importance
// Sampling of Many Lights with Adaptive Tree Splitting", HPG 2018; the bound by cones follows M.
// Pharr, W. Jakob, G. Humphreys, "Physically Based Rendering", 4th edition, 12.6.3.
#pragma once

#include "core/rng.h"
#include "lights/receiver.h"
#include "lights/tree_view.h"

namespace veriray {

// Cosine of an angle less another one, at least 0, given the cosines and the latter's sine.
template <class F>
VR_HD F cosine_less(F cosine, F less_cosine, F less_sine) {
    const F one(1.f), sine = sqrt(max(one - cosine * cosine, F(0.f)));
    return select(cosine >= less_cosine, one, fma(cosine, less_cosine, sine * less_sine));
}

template <class L>
struct LightTree {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;

    struct Choice {
        U row;     // of the light table
        F chance;  // the product of the branches' shares
    };
    struct Place {
        V p, n;
        M surface, both;
    };
    static VR_HD Place place_of(const LightReceiver<L>& at) {
        const U sides = at.facing & U(3u);
        return {at.p, facing_normal<F>(at.facing), !(sides == U(kAllSides)),
                sides == U(kBothSides)};
    }

    // What a branch can give: a bound on the irradiance but for its scale and for places so near
    // that it depends on the light's extent. read(c): the column of its record.
    template <class Read>
    static VR_HD F importance(Read read, const Place& at) {
        const F zero(0.f), one(1.f), radius = read(kBranchRadius);
        const M far = radius < zero;
        const V where{read(kBranchP), read(kBranchP + 1), read(kBranchP + 2)};
        const V to = select(far, where, where - at.p);
        const F r = max(radius, zero), r2 = r * r, d2 = dot(to, to);
        const M within = (!(d2 > r2)) | (radius < F(kFarOff));
        const F inverse = one / sqrt(d2);
        // The ball's half angle; rounding of cosines is within kAngleSlack.
        const F sine = min(r * inverse, one), cosine = sqrt(max(one - sine * sine, zero));
        const V axis{read(kBranchAxis), read(kBranchAxis + 1), read(kBranchAxis + 2)};
        const F off =
            cosine_less(-(dot(axis, to) * inverse), read(kBranchWide), read(kBranchWideSine));
        const F edge = (cosine_less(off, cosine, sine) - read(kBranchEdge)) * read(kBranchInverse);
        const F emitted = select(within, one, min(max(edge, zero), one));
        const F up = dot(at.n, to) * inverse;
        const F seen = cosine_less(select(at.both, abs(up), up), cosine, sine);
        const F received = select(within | !at.surface, one, max(seen + F(kAngleSlack), zero));
        return read(kBranchStrength) * (emitted * received) / max(max(d2, r2), F(0x1p-80f));
    }

    // The branches of a node, and their shares.
    struct Shares {
        F weight[kMostBranches];
        F total;
        U positive;  // how many have a share
        uint32_t n;  // of all lanes

        // record(k): reads the columns of branch k; has(k): the lanes that have it.
        template <class Record, class Has>
        VR_HD Shares(uint32_t most, Record record, Has has, const Place& at) : n(most) {
            total = F(0.f);
            VR_ROLLED
            for (uint32_t k = 0; k < n; ++k) {
                const F w = importance(record(k), at);
                weight[k] = select(has(k) & (w > F(0.f)), w, F(0.f));
                total = total + weight[k];
            }
            // Where nothing can give anything, all count alike.
            const M nothing = !(total > F(0.f));
            positive = U(0u);
            F sum(0.f);
            for (uint32_t k = 0; k < n; ++k) {
                weight[k] = select(nothing & has(k), F(1.f), weight[k]);
                sum = sum + weight[k];
                positive = select(weight[k] > F(0.f), positive + U(1u), positive);
            }
            total = sum;
        }
        // Calls visit(k, begin, end) with the branches' intervals of [0, 2^24), which are empty
        // where the weight is 0 and only there.
        template <class Visit>
        VR_HD void each(Visit visit) const {
            const F spare = to_float(less(U(1u << 24), positive)), scale = spare / total;
            F sum(0.f);
            U rank(0u), begin(0u);
            for (uint32_t k = 0; k < n; ++k) {
                const M some = weight[k] > F(0.f);
                sum = sum + weight[k];
                rank = select(some, rank + U(1u), rank);
                U end = to_uint(min(sum * scale, spare)) + rank;
                end = select(rank == positive, U(1u << 24), end);
                end = select(some, end, begin);
                visit(k, begin, end);
                begin = end;
            }
        }
    };

    static VR_HD Shares root_shares(const LightTreeView& tree, const Place& at, M lanes) {
        return Shares(
            tree.root,
            [&](uint32_t k) VR_INLINED {
                const float* columns = tree.branches + k * kBranchFloats;
                return [columns](uint32_t c) VR_INLINED { return F(columns[c]); };
            },
            [&](uint32_t) VR_INLINED { return lanes | !lanes; }, at);
    }
    static VR_HD Shares shares(const LightTreeView& tree, U first, U count, const Place& at,
                               M lanes) {
        uint32_t most = 0;
        while (any(lanes & (U(most) < count))) ++most;
        return Shares(
            most,
            [&](uint32_t k) VR_INLINED {
                const U branch = first + select(U(k) < count, U(k), U(0u));
                return BranchRecord<F>(tree.branches, branch * U(kBranchFloats));
            },
            [&](uint32_t k) VR_INLINED { return U(k) < count; }, at);
    }
    static VR_HD U number(const LightTreeView& tree, U branch, uint32_t c) {
        return as_uint(gather(tree.branches + c, branch * U(kBranchFloats)));
    }
    static VR_HD U chosen(const Shares& s, U first, U u24, F& chance) {
        U branch = first, size(0u);
        s.each([&](uint32_t k, U begin, U end) VR_INLINED {
            const M here = !(u24 < begin) & (u24 < end);
            branch = select(here, first + U(k), branch);
            size = select(here, less(end, begin), size);
        });
        chance = chance * (to_float(size) * F(0x1p-24f));
        return branch;
    }

    // u24 chooses at the root; further numbers are drawn where the tree is deeper.
    static VR_LONG Choice choose(LightTreeView tree, LightReceiver<L> at, U u24,
                                 RandomStream<U> random, M lanes) {
        const Place place = place_of(at);
        Choice choice{U(0u), F(1.f)};
        U branch = chosen(root_shares(tree, place, lanes), U(0u), u24, choice.chance);
        M todo = lanes & !(number(tree, branch, kBranchCount) == U(0u));
        while (any(todo)) {
            const U first = select(todo, number(tree, branch, kBranchFirst), U(0u));
            const U count = select(todo, number(tree, branch, kBranchCount), U(1u));
            const U u = next_block(random, todo).x >> 8;
            F chance = choice.chance;
            const U next = chosen(shares(tree, first, count, place, todo), first, u, chance);
            choice.chance = select(todo, chance, choice.chance);
            branch = select(todo, next, branch);
            todo = todo & !(number(tree, branch, kBranchCount) == U(0u));
        }
        choice.row =
            select(lanes, number(tree, branch, kBranchFirst), U(0u));  // others are at nodes
        return choice;
    }

    // With which a light is chosen; `branch`: its leaf.
    static VR_LONG F chance(LightTreeView tree, LightReceiver<L> at, U branch, M lanes) {
        const Place place = place_of(at);
        const auto share = [&](const Shares& s, U index) VR_INLINED {
            U size(0u);
            s.each([&](uint32_t k, U begin, U end)
                       VR_INLINED { size = select(index == U(k), less(end, begin), size); });
            return to_float(size) * F(0x1p-24f);
        };
        F chance(1.f);
        U up = number(tree, branch, kBranchUp);
        M todo = lanes & !(up == U(~0u));
        while (any(todo)) {
            const U node = select(todo, up, U(0u));
            const U first = select(todo, number(tree, node, kBranchFirst), U(0u));
            const U count = select(todo, number(tree, node, kBranchCount), U(1u));
            const F one = share(shares(tree, first, count, place, todo), less(branch, first));
            chance = select(todo, chance * one, chance);
            branch = select(todo, up, branch);
            up = number(tree, branch, kBranchUp);
            todo = todo & !(up == U(~0u));
        }
        return chance * share(root_shares(tree, place, lanes), branch);
    }
};

}  // namespace veriray
