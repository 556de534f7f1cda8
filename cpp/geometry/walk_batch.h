// The CPU's traversal: one ray tests a node of eight boxes or a leaf of up to eight records at
// once. In a tree that caches hold, one ray follows another, and what it needs stays in registers.
// In a larger one the rays take turns, one node each, so memory loads what the others need
// meanwhile. I. Wald, C. Benthin, S. Boulos, "Getting Rid of Packets", RT 2008.
#pragma once

#include "geometry/bvh.h"

namespace veriray {

inline constexpr uint32_t kCpuStack = 7 * 64 + 1;  // seven siblings per level of the deepest tree

// The rays of the lanes during traversal.
template <class L>
struct Walkers {
    static constexpr uint32_t kWidth = L::kWidth;
    float o[3][kWidth], d[3][kWidth], inverse[3][kWidth], near[3][kWidth], far[3][kWidth];
    float sheared_o[3][kWidth], shear[2][kWidth];      // main axis last
    uint32_t near_row[3][kWidth], far_row[3][kWidth];  // rows of a node, in floats
    uint32_t axis[3][kWidth];                          // main axis last
    float t[kWidth], after[kWidth];                    // hits count beyond (after, passed)
    uint32_t passed[kWidth], primitive[kWidth];

    VR_HD Walkers(const BvhView& bvh, const Ray<L>& ray, const Hit<L>& last, typename L::F t_max,
                  typename L::U first) {
        using F = typename L::F;
        using U = typename L::U;
        const Slabs<L> s = slabs_of<L>(ray, bvh.slack);
        const Shear<L> h = shear_of<L>(ray.d);
        put(o, ray.o), put(d, ray.d), put(inverse, s.inverse), put(near, s.near), put(far, s.far);
        put(sheared_o, main_axis_last(h.from_x, h.from_y, ray.o));
        store(shear[0], h.x), store(shear[1], h.y);
        const F towards[3] = {s.inverse.x, s.inverse.y, s.inverse.z};
        for (uint32_t k = 0; k < 3; ++k) {
            const auto down = towards[k] < F(0.f);
            const U low(k * kCpuWidth), high((3 + k) * kCpuWidth);
            store(near_row[k], select(down, high, low));
            store(far_row[k], select(down, low, high));
        }
        store(axis[0], select(h.from_x, U(2u), U(0u)));
        store(axis[1], select(h.from_y, U(2u), U(1u)));
        store(axis[2], select(h.from_x, U(0u), select(h.from_y, U(1u), U(2u))));
        store(after, last.t), store(passed, last.primitive);
        store(t, t_max), store(primitive, first);
    }

   private:
    VR_HD void put(float (&column)[3][kWidth], Vec3<typename L::F> v) {
        store(column[0], v.x), store(column[1], v.y), store(column[2], v.z);
    }
};

template <uint32_t n>
VR_HD Vec3<Batch::F> all_of(const float (&column)[3][n], uint32_t lane) {
    return {Batch::F(column[0][lane]), Batch::F(column[1][lane]), Batch::F(column[2][lane])};
}

// Ray i of the lanes, for all boxes or records of a node or leaf, read where it is needed.
template <class L>
struct LaneRay {
    using F = Batch::F;
    Walkers<L>& lanes;
    const uint32_t i;

    VR_HD Slabs<Batch> slabs() const {
        return {all_of(lanes.inverse, i), all_of(lanes.near, i), all_of(lanes.far, i)};
    }
    VR_HD Vec3<F> sheared_o() const { return all_of(lanes.sheared_o, i); }
    VR_HD Shear<Batch> shear() const {
        return {{}, {}, F(lanes.shear[0][i]), F(lanes.shear[1][i])};
    }
    VR_HD F after() const { return F(lanes.after[i]); }
    VR_HD float t() const { return lanes.t[i]; }
    VR_HD uint32_t primitive() const { return lanes.primitive[i]; }
    VR_HD void set(float at, uint32_t what) { lanes.t[i] = at, lanes.primitive[i] = what; }
};

// The same, kept in registers.
template <class L>
struct KeptRay {
    using F = Batch::F;
    Walkers<L>& lanes;
    const uint32_t i;
    const Slabs<Batch> slabs_;
    const Vec3<F> sheared_o_;
    const Shear<Batch> shear_;
    const F after_;
    float t_;
    uint32_t primitive_;

    VR_HD explicit KeptRay(const LaneRay<L>& r)
        : lanes(r.lanes),
          i(r.i),
          slabs_(r.slabs()),
          sheared_o_(r.sheared_o()),
          shear_(r.shear()),
          after_(r.after()),
          t_(r.t()),
          primitive_(r.primitive()) {}
    VR_HD const Slabs<Batch>& slabs() const { return slabs_; }
    VR_HD Vec3<F> sheared_o() const { return sheared_o_; }
    VR_HD const Shear<Batch>& shear() const { return shear_; }
    VR_HD F after() const { return after_; }
    VR_HD float t() const { return t_; }
    VR_HD uint32_t primitive() const { return primitive_; }
    VR_HD void set(float at, uint32_t what) { t_ = at, primitive_ = what; }
};

// Children whose boxes the ray enters within its t, as bits, and the distances.
template <class AnyRay>
VR_HD uint32_t entered(const WideNode<kCpuWidth>& node, const AnyRay& r,
                       float (&entry)[kCpuWidth]) {
    using F = Batch::F;
    const float* rows = node.lo[0];
    uint32_t hits = 0;
    for (uint32_t k = 0; k < kCpuWidth; k += Batch::kWidth) {
        const auto at = [&](const auto& row, uint32_t a, F inverse, F start) VR_INLINED {
            return fma(load(rows + row[a][r.i] + k, F()), inverse, start);
        };
        const Slabs<Batch>& s = r.slabs();
        const F in = max(max(at(r.lanes.near_row, 0, s.inverse.x, s.near.x),
                             at(r.lanes.near_row, 1, s.inverse.y, s.near.y)),
                         max(at(r.lanes.near_row, 2, s.inverse.z, s.near.z), r.after()));
        const F out = min(min(at(r.lanes.far_row, 0, s.inverse.x, s.far.x),
                              at(r.lanes.far_row, 1, s.inverse.y, s.far.y)),
                          min(at(r.lanes.far_row, 2, s.inverse.z, s.far.z), F(r.t())));
        store(entry + k, in);
        hits |= bits(in <= out) << k;
    }
    return hits;
}

VR_HD uint32_t record_primitive(const float* rows, uint32_t count, uint32_t j) {
    return as_uint(rows[kRecordId * count + j]) & ((1u << kRecordKindShift) - 1u);
}

// Those of the leaf's `count` records that the ray meets within its t, as bits, and the distances.
template <uint32_t kKinds, class AnyRay>
VR_HD uint32_t leaf_hits(const float* rows, uint32_t count, const AnyRay& r, float (&t)[kCpuLeaf]) {
    using F = Batch::F;
    const auto& w = r.lanes;
    const uint32_t i = r.i;
    const uint64_t corner = 3 * count;
    uint32_t hits = 0;
    for (uint32_t k = 0; k < kCpuLeaf; k += Batch::kWidth) {
        const Vec3<F> o = r.sheared_o();
        const float *x = rows + w.axis[0][i] * count + k, *y = rows + w.axis[1][i] * count + k,
                    *z = rows + w.axis[2][i] * count + k;
        const Vec3<F> v[3] = {
            Vec3<F>{load(x, F()), load(y, F()), load(z, F())} - o,
            Vec3<F>{load(x + corner, F()), load(y + corner, F()), load(z + corner, F())} - o,
            Vec3<F>{load(x + 2 * corner, F()), load(y + 2 * corner, F()),
                    load(z + 2 * corner, F())} -
                o};
        hits |= bits(inside_sheared<Batch>(r.shear(), v)) << k;
    }
    hits &= (1u << count) - 1u;
    for (uint32_t k = 0; k < kCpuLeaf; k += Batch::kWidth) {
        if (!(hits >> k)) break;
        const Slabs<Batch>& s = r.slabs();
        const auto row = [&](uint32_t c) VR_INLINED { return load(rows + c * count + k, F()); };
        const Vec3<F> v[3] = {
            {row(0), row(1), row(2)}, {row(3), row(4), row(5)}, {row(6), row(7), row(8)}};
        const Ray<Batch> ray{all_of(w.o, i), all_of(w.d, i)};
        const Vec3<F> n{row(kRecordPlane), row(kRecordPlane + 1), row(kRecordPlane + 2)};
        const F height =
            fma(n.z, ray.o.z, fma(n.y, ray.o.y, fma(n.x, ray.o.x, row(kRecordPlane + 3))));
        const F at = bounded_distance<Batch>(-height / dot(n, ray.d), s, v);
        store(t + k, at);
        const auto ahead = (at > F(0.f)) & (at >= r.after()) & (at <= F(r.t()));
        hits &= ~(((1u << Batch::kWidth) - 1u) << k) | bits(ahead) << k;
    }
    if constexpr (kKinds != kTreeTriangles)
        for (uint32_t j = 0; j < count; ++j) {
            const uint32_t kind = as_uint(rows[kRecordId * count + j]) >> kRecordKindShift & 3u;
            if (kind == kTriangleRecord) continue;
            float record[12];
            for (uint32_t c = 0; c < 12; ++c) record[c] = rows[c * count + j];
            const auto one = [&](const auto& column) VR_INLINED {
                return Scalar3{column[0][i], column[1][i], column[2][i]};
            };
            t[j] = round_distance<kKinds>(
                record, kind, record_primitive(rows, count, j), {one(w.o), one(w.d)},
                {one(w.inverse), one(w.near), one(w.far)}, {w.after[i], w.passed[i]});
            hits = (hits & ~(1u << j)) | (t[j] <= r.t() && t[j] < kInfinity ? 1u << j : 0u);
        }
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
    // A second one without a branch, which the processor could not foresee.
    const uint64_t second = key(static_cast<uint32_t>(__builtin_ctz(hits | 1u << (kCpuWidth - 1))));
    const bool two = hits != 0, swap = !kAny & two & (second < nearest);
    uint64_t* const base = stack.top;
    *base = swap ? nearest : second;
    nearest = swap ? second : nearest;
    stack.top += two;
    hits &= hits - 1;
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

// One node or leaf of the traversal; returns whether it goes on, with `node`. kAny: it ends at any
// hit, with t = -1.
template <uint32_t kKinds, bool kAny, class AnyRay>
VR_HD bool step(const BvhView& bvh, AnyRay& r, WalkStack& stack, uint32_t& node) {
    if (node & kLeafFlag) {
        const float* rows =
            static_cast<const RecordBlock*>(bvh.records)[(node & ~kLeafFlag) >> 4].f;
        const uint32_t count = (node & 15u) + 1;
        float t[kCpuLeaf];
        for (uint32_t m = leaf_hits<kKinds>(rows, count, r, t); m; m &= m - 1) {
            const uint32_t j = static_cast<uint32_t>(__builtin_ctz(m));
            const uint32_t primitive = record_primitive(rows, count, j);
            if constexpr (kAny) {
                if (t[j] < r.t() && primitive != r.primitive())
                    return r.set(-1.f, primitive), false;
            } else if (closer(t[j], primitive, {r.t(), r.primitive()},
                              {r.lanes.after[r.i], r.lanes.passed[r.i]})) {
                r.set(t[j], primitive);
            }
        }
    } else {
        const auto& n = static_cast<const WideNode<kCpuWidth>*>(bvh.nodes)[node];
        float entry[kCpuWidth];
        if (const uint32_t hits = entered(n, r, entry)) {
            node = put_off<kAny>(n, hits, entry, stack);
            if (node != kEmptyChild) return true;
        }
    }
    for (;;) {
        if (stack.top == stack.entries) return false;
        const uint64_t top = *--stack.top;
        node = static_cast<uint32_t>(top);
        if (!(as_float(static_cast<uint32_t>(top >> 32)) > r.t()) && node != kEmptyChild)
            return true;
    }
}

VR_HD void fetch(const BvhView& bvh, uint32_t node) {
    const bool leaf = node & kLeafFlag;
    const char* p = static_cast<const char*>(leaf ? bvh.records : bvh.nodes);
    p += leaf ? uint64_t{(node & ~kLeafFlag) >> 4} * sizeof(RecordBlock)
              : uint64_t{node} * sizeof(WideNode<kCpuWidth>);
    const uint32_t bytes = leaf ? ((node & 15u) + 1) * 36 : sizeof(WideNode<kCpuWidth>);
    for (uint32_t i = 0; i < bytes; i += 64) __builtin_prefetch(p + i);
}

// Rays `active`, one after another.
template <uint32_t kKinds, bool kAny, class L>
static VR_CALLED void walk_in_order(const BvhView& bvh, Walkers<L>& w, uint32_t active) {
    WalkStack stack;
    for (; active; active &= active - 1) {
        const uint32_t i = static_cast<uint32_t>(__builtin_ctz(active));
        KeptRay<L> r(LaneRay<L>{w, i});
        stack.top = stack.entries;
        uint32_t node = 0;
        while (step<kKinds, kAny>(bvh, r, stack, node)) {
        }
        w.t[i] = r.t(), w.primitive[i] = r.primitive();
    }
}

// The same in turns.
template <uint32_t kKinds, bool kAny, class L>
static VR_CALLED void walk_in_turns(const BvhView& bvh, Walkers<L>& w, uint32_t active) {
    WalkStack stacks[L::kWidth];
    uint32_t node[L::kWidth] = {}, on_way[L::kWidth], n = 0;
    for (; active; active &= active - 1) on_way[n++] = static_cast<uint32_t>(__builtin_ctz(active));
    while (n > 0)
        for (uint32_t k = 0; k < n;) {
            const uint32_t i = on_way[k];
            LaneRay<L> r{w, i};
            if (step<kKinds, kAny>(bvh, r, stacks[i], node[i]))
                fetch(bvh, node[i]), ++k;
            else
                on_way[k] = on_way[--n];
        }
}

template <uint32_t kKinds, bool kAny, class L>
VR_HD void walk(const BvhView& bvh, Walkers<L>& w, typename L::M active) {
    if (bvh.large)
        walk_in_turns<kKinds, kAny>(bvh, w, bits(active));
    else
        walk_in_order<kKinds, kAny>(bvh, w, bits(active));
}

template <class L, uint32_t kKinds>
VR_HD void closest_in_bvh(const BvhView& bvh, const Ray<L>& ray, const Hit<L>& last,
                          typename L::M active, Hit<L>& hit) {
    Walkers<L> w(bvh, ray, last, hit.t, hit.primitive);
    walk<kKinds, false>(bvh, w, active);
    hit.t = load(w.t, typename L::F()), hit.primitive = load(w.primitive, typename L::U());
}

// Those lanes of `active` that meet a primitive other than `skip` before t_max.
template <class L, uint32_t kKinds>
VR_HD typename L::M occluded_in_bvh(const BvhView& bvh, const Ray<L>& ray, typename L::F t_max,
                                    typename L::M active, typename L::U skip) {
    Walkers<L> w(bvh, ray, nothing_met<L>(), t_max, skip);
    walk<kKinds, true>(bvh, w, active);
    using F = typename L::F;
    return active & (t_max > F(0.f)) & (load(w.t, F()) < F(0.f));
}

}  // namespace veriray
