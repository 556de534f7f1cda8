// The CPU's traversal. In a tree that caches hold one ray follows another, and what it needs stays
// in registers; in a larger one the rays take turns (walk_turns.h).
#pragma once

#include "geometry/walk_packet.h"

namespace veriray {

// Ray i of the lanes, in registers.
template <class L>
struct Walker {
    using F = Simd::F;
    const Walkers<L>& lanes;
    const uint32_t i;
    const Slabs<Simd> slabs;
    const Vec3<F> sheared_o;
    const Shear<Simd> shear;
    const F after;
    float t;  // of the closest hit
    uint32_t primitive;

    VR_HD Walker(const Walkers<L>& w, uint32_t lane)
        : lanes(w),
          i(lane),
          slabs{all_of(w.inverse, i), all_of(w.near, i), all_of(w.far, i)},
          sheared_o(all_of(w.sheared_o, i)),
          shear{{}, {}, F(w.shear[0][i]), F(w.shear[1][i])},
          after(w.after[i]),
          t(w.t[i]),
          primitive(w.primitive[i]) {}
};

// Children whose boxes the ray enters within its t, as bits, and the distances.
template <class L>
VR_HD uint32_t entered(const WideNode<kCpuWidth>& node, const Walker<L>& r,
                       float (&entry)[kCpuWidth]) {
    using F = Simd::F;
    const float* rows = node.lo[0];
    uint32_t hits = 0;
    for (uint32_t k = 0; k < kCpuWidth; k += Simd::kWidth) {
        const auto at =
            [&](const uint32_t (&row)[3][L::kWidth], uint32_t a, F inverse, F start)
                VR_INLINED { return fma(load(rows + row[a][r.i] + k, F()), inverse, start); };
        const Slabs<Simd>& s = r.slabs;
        const F in = max(max(at(r.lanes.near_row, 0, s.inverse.x, s.near.x),
                             at(r.lanes.near_row, 1, s.inverse.y, s.near.y)),
                         max(at(r.lanes.near_row, 2, s.inverse.z, s.near.z), r.after));
        const F out = min(min(at(r.lanes.far_row, 0, s.inverse.x, s.far.x),
                              at(r.lanes.far_row, 1, s.inverse.y, s.far.y)),
                          min(at(r.lanes.far_row, 2, s.inverse.z, s.far.z), F(r.t)));
        store(entry + k, in);
        hits |= bits(in <= out) << k;
    }
    return hits;
}

// Those of the leaf's `count` records that the ray meets within its t, as bits, and the distances.
template <uint32_t kKinds, class L>
VR_HD uint32_t leaf_hits(const float* rows, uint32_t count, const Walker<L>& r,
                         float (&t)[kCpuLeaf]) {
    using F = Simd::F;
    const Walkers<L>& w = r.lanes;
    const uint32_t i = r.i;
    const uint64_t corner = 3 * count;
    uint32_t hits = 0;
    for (uint32_t k = 0; k < kCpuLeaf; k += Simd::kWidth) {
        const Vec3<F> o = r.sheared_o;
        const float *x = rows + w.axis[0][i] * count + k, *y = rows + w.axis[1][i] * count + k,
                    *z = rows + w.axis[2][i] * count + k;
        const Vec3<F> v[3] = {
            Vec3<F>{load(x, F()), load(y, F()), load(z, F())} - o,
            Vec3<F>{load(x + corner, F()), load(y + corner, F()), load(z + corner, F())} - o,
            Vec3<F>{load(x + 2 * corner, F()), load(y + 2 * corner, F()),
                    load(z + 2 * corner, F())} -
                o};
        hits |= bits(inside_sheared<Simd>(r.shear, v)) << k;
    }
    hits &= (1u << count) - 1u;
    for (uint32_t k = 0; k < kCpuLeaf; k += Simd::kWidth) {
        if (!(hits >> k)) break;
        const auto row = [&](uint32_t c) VR_INLINED { return load(rows + c * count + k, F()); };
        const Vec3<F> v[3] = {
            {row(0), row(1), row(2)}, {row(3), row(4), row(5)}, {row(6), row(7), row(8)}};
        const Ray<Simd> ray{all_of(w.o, i), all_of(w.d, i)};
        const Vec3<F> n{row(kRecordPlane), row(kRecordPlane + 1), row(kRecordPlane + 2)};
        const F height =
            fma(n.z, ray.o.z, fma(n.y, ray.o.y, fma(n.x, ray.o.x, row(kRecordPlane + 3))));
        const F at = bounded_distance<Simd>(-height / dot(n, ray.d), r.slabs, v);
        store(t + k, at);
        const auto ahead = (at > F(0.f)) & (at >= r.after) & (at <= F(r.t));
        hits &= ~(((1u << Simd::kWidth) - 1u) << k) | bits(ahead) << k;
    }
    if constexpr (kKinds != kTreeTriangles)
        hits = round_hits<kKinds>(rows, count, w, i, r.t, hits, t);
    return hits;
}

// The children waiting, the nearest on top: bits of the entry distance, child.
struct WalkStack {
    uint64_t entries[kCpuStack];
    uint64_t* top = entries;
};

// Puts all but one of the children `hits`, which are not none, on the stack, and returns that: the
// nearest, or any if kAny.
template <bool kAny>
VR_HD uint32_t put_off(const WideNode<kCpuWidth>& n, uint32_t hits, const float (&entry)[kCpuWidth],
                       WalkStack& stack) {
    const auto key = [&](uint32_t k) VR_INLINED {
        return static_cast<uint64_t>(as_uint(entry[k])) << 32 | n.child[k];
    };
    uint64_t nearest = key(static_cast<uint32_t>(__builtin_ctz(hits)));
    hits &= hits - 1;
    if (!hits) return static_cast<uint32_t>(nearest);
    uint64_t* const base = stack.top;
    for (; hits; hits &= hits - 1) {
        const uint64_t other = key(static_cast<uint32_t>(__builtin_ctz(hits)));
        const bool nearer = !kAny & (other < nearest);
        const uint64_t farther = nearer ? nearest : other;
        nearest = nearer ? other : nearest;
        uint64_t* at = stack.top++;
        if (!kAny)
            for (; at > base && at[-1] < farther; --at) *at = at[-1];
        *at = farther;
    }
    return static_cast<uint32_t>(nearest);
}

// The traversal of one ray. kAny: stop at any hit, with t = -1.
template <uint32_t kKinds, bool kAny, class L>
VR_HD void walk_one(const BvhView& bvh, Walker<L>& r) {
    const auto* nodes = static_cast<const WideNode<kCpuWidth>*>(bvh.nodes);
    const auto* blocks = static_cast<const RecordBlock*>(bvh.records);
    WalkStack stack;
    uint32_t next = 0;
    for (;;) {
        if (next & kLeafFlag) {
            const float* rows = blocks[(next & ~kLeafFlag) >> 4].f;
            const uint32_t count = (next & 15u) + 1;
            float t[kCpuLeaf];
            for (uint32_t m = leaf_hits<kKinds>(rows, count, r, t); m; m &= m - 1) {
                const uint32_t j = static_cast<uint32_t>(__builtin_ctz(m));
                const uint32_t primitive = record_primitive(rows, count, j);
                if constexpr (kAny) {
                    if (t[j] < r.t && primitive != r.primitive) {
                        r.t = -1.f;
                        return;
                    }
                } else if (closer<Scalar>(t[j], primitive, {r.t, r.primitive},
                                          {r.lanes.after[r.i], r.lanes.passed[r.i]})) {
                    r.t = t[j], r.primitive = primitive;
                }
            }
        } else {
            const WideNode<kCpuWidth>& n = nodes[next];
            float entry[kCpuWidth];
            if (const uint32_t hits = entered(n, r, entry)) {
                next = put_off<kAny>(n, hits, entry, stack);
                if (next != kEmptyChild) continue;
            }
        }
        uint64_t top;
        do {
            if (stack.top == stack.entries) return;
            top = *--stack.top;
            next = static_cast<uint32_t>(top);
        } while (as_float(static_cast<uint32_t>(top >> 32)) > r.t || next == kEmptyChild);
    }
}

// Rays `active`, one after another.
template <uint32_t kKinds, bool kAny, class L>
VR_CALLED void walk_in_order(const BvhView& bvh, Walkers<L>& w, uint32_t active) {
    for (; active; active &= active - 1) {
        Walker<L> r(w, static_cast<uint32_t>(__builtin_ctz(active)));
        walk_one<kKinds, kAny>(bvh, r);
        w.t[r.i] = r.t, w.primitive[r.i] = r.primitive;
    }
}

template <uint32_t kKinds, bool kAny, class L>
VR_HD void walk(const BvhView& bvh, Walkers<L>& w, typename L::M active) {
    if constexpr (kKinds != kTreeTriangles)
        if (!bvh.round) return walk<kTreeTriangles, kAny>(bvh, w, active);
    if (bvh.large)
        walk_in_turns<kKinds, kAny>(bvh, w, bits(active));
    else
        walk_in_order<kKinds, kAny>(bvh, w, bits(active));
}

template <class L, uint32_t kKinds>
VR_HD void closest_in_bvh(const BvhView& bvh, const Ray<L>& ray, const Hit<L>& last,
                          typename L::M active, Hit<L>& hit) {
    const Slabs<L> slabs = slabs_of<L>(ray, bvh.slack);
    const Shear<L> shear = shear_of<L>(ray.d);
    if constexpr (L::kWidth > 1) {
        Packet<L> p(bvh, ray, last, slabs, shear, hit.t, active);
        if (p.together)
            return bvh.round ? walk_together<kKinds>(bvh, p, hit)
                             : walk_together<kTreeTriangles>(bvh, p, hit);
    }
    Walkers<L> w(ray, slabs, shear, last, hit.t, hit.primitive);
    walk<kKinds, false>(bvh, w, active);
    hit.t = load(w.t, typename L::F()), hit.primitive = load(w.primitive, typename L::U());
}

// Those lanes of `active` that meet a primitive other than `skip` before t_max.
template <class L, uint32_t kKinds>
VR_HD typename L::M occluded_in_bvh(const BvhView& bvh, const Ray<L>& ray, typename L::F t_max,
                                    typename L::M active, typename L::U skip) {
    Walkers<L> w(ray, slabs_of<L>(ray, bvh.slack), shear_of<L>(ray.d), nothing_met<L>(), t_max,
                 skip);
    walk<kKinds, true>(bvh, w, active);
    using F = typename L::F;
    return active & (t_max > F(0.f)) & (load(w.t, F()) < F(0.f));
}

}  // namespace veriray
