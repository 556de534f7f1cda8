// The CPU's traversal of a large tree: one ray tests all boxes of a node or all records of a leaf
// at once, and the rays of the lanes take turns, one node each, so that memory loads what the
// others need meanwhile. I. Wald, C. Benthin, S. Boulos, "Getting Rid of Packets", RT 2008.
#pragma once

#include "geometry/bvh.h"

namespace veriray {

// Children of a node and records of a leaf: one vector, but eight at least. Not `inline`: other
// translation units have vectors of other widths.
constexpr uint32_t kCpuWidth = Simd::kWidth > 8 ? Simd::kWidth : 8, kCpuLeaf = kCpuWidth;
constexpr uint32_t kCpuStack = (kCpuWidth - 1) * 64 + 1;  // siblings per level of the deepest tree

// The rays of the lanes during traversal.
template <class L>
struct Walkers {
    static constexpr uint32_t kWidth = L::kWidth;
    float o[3][kWidth], d[3][kWidth], inverse[3][kWidth], near[3][kWidth], far[3][kWidth];
    float sheared_o[3][kWidth], shear[2][kWidth];      // main axis last
    uint32_t near_row[3][kWidth], far_row[3][kWidth];  // rows of a node, in floats
    uint32_t axis[3][kWidth];                          // main axis last
    float t[kWidth], after[kWidth];                    // hits count beyond (after, passed)
    uint32_t passed[kWidth], primitive[kWidth], node[kWidth], waiting[kWidth];
    uint64_t stack[kWidth][kCpuStack];  // bits of the entry distance, child

    VR_HD Walkers(const Ray<L>& ray, const Slabs<L>& s, const Shear<L>& h, const Hit<L>& last,
                  typename L::F t_max, typename L::U first) {
        using F = typename L::F;
        using U = typename L::U;
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
        store(t, t_max), store(primitive, first), store(node, U(0u)), store(waiting, U(0u));
    }

   private:
    VR_HD void put(float (&column)[3][kWidth], Vec3<typename L::F> v) {
        store(column[0], v.x), store(column[1], v.y), store(column[2], v.z);
    }
};

template <uint32_t n>
VR_HD Vec3<Simd::F> all_of(const float (&column)[3][n], uint32_t lane) {
    return {Simd::F(column[0][lane]), Simd::F(column[1][lane]), Simd::F(column[2][lane])};
}

// Children whose boxes ray i enters within its t, as bits, and the distances.
template <class L>
VR_HD uint32_t entered(const WideNode<kCpuWidth>& node, const Walkers<L>& w, uint32_t i,
                       float (&entry)[kCpuWidth]) {
    using F = Simd::F;
    const float* rows = node.lo[0];
    uint32_t hits = 0;
    for (uint32_t k = 0; k < kCpuWidth; k += Simd::kWidth) {
        const auto near = [&](uint32_t a) {
            return fma(load(rows + w.near_row[a][i] + k, F()), F(w.inverse[a][i]), F(w.near[a][i]));
        };
        const auto far = [&](uint32_t a) {
            return fma(load(rows + w.far_row[a][i] + k, F()), F(w.inverse[a][i]), F(w.far[a][i]));
        };
        const F in = max(max(near(0), near(1)), max(near(2), F(w.after[i])));
        const F out = min(min(far(0), far(1)), min(far(2), F(w.t[i])));
        store(entry + k, in);
        hits |= bits(in <= out) << k;
    }
    return hits;
}

VR_HD uint32_t record_primitive(const float* rows, uint32_t count, uint32_t j) {
    return as_uint(rows[kRecordId * count + j]) & ((1u << kRecordKindShift) - 1u);
}

VR_HD uint32_t record_kind(const float* rows, uint32_t count, uint32_t j) {
    return as_uint(rows[kRecordId * count + j]) >> kRecordKindShift & 3u;
}

// The same `hits` of a leaf's records with those of its spheres and discs that ray i meets within
// t_max. Of several spheres, those that it clearly misses are found at once.
template <uint32_t kKinds, class L>
VR_HD uint32_t round_hits(const float* rows, uint32_t count, const Walkers<L>& w, uint32_t i,
                          float t_max, uint32_t hits, float (&t)[kCpuLeaf]) {
    using F = Simd::F;
    using U = Simd::U;
    uint32_t round = 0;
    for (uint32_t k = 0; k < count; k += Simd::kWidth) {
        const auto row = [&](uint32_t c) VR_INLINED { return load(rows + c * count + k, F()); };
        const U kind = as_uint(row(kRecordId)) >> kRecordKindShift & U(3u);
        const uint32_t others = bits(!(kind == U(kTriangleRecord))) << k;
        hits &= ~others, round |= others;
        if constexpr (kKinds & kTreeSpheres) {
            const uint32_t spheres = bits(kind == U(kSphereRecord));
            if (!(spheres & (spheres - 1))) continue;
            F record[kSphereFloats];
            for (uint32_t c = 0; c < kSphereFloats; ++c) record[c] = row(c);
            const Ray<Simd> ray{all_of(w.o, i), all_of(w.d, i)};
            round &= ~((spheres & ~bits(may_meet_sphere<Simd>(record, ray, F(kInfinity)))) << k);
        }
    }
    round &= (1u << count) - 1u;
    for (; round; round &= round - 1) {
        const uint32_t j = static_cast<uint32_t>(__builtin_ctz(round));
        float record[12];
        for (uint32_t c = 0; c < 12; ++c) record[c] = rows[c * count + j];
        const auto one = [&](const float (&column)[3][L::kWidth]) {
            return Scalar3{column[0][i], column[1][i], column[2][i]};
        };
        t[j] = round_distance<kKinds, Scalar>(
            record, record_kind(rows, count, j), record_primitive(rows, count, j),
            {one(w.o), one(w.d)}, {one(w.inverse), one(w.near), one(w.far)},
            {w.after[i], w.passed[i]});
        hits |= static_cast<uint32_t>(t[j] <= t_max && t[j] < kInfinity) << j;
    }
    return hits;
}

// Those of the leaf's `count` records that ray i meets within its t, as bits, and the distances.
template <uint32_t kKinds, class L>
VR_HD uint32_t leaf_hits(const float* rows, uint32_t count, const Walkers<L>& w, uint32_t i,
                         float (&t)[kCpuLeaf]) {
    using F = Simd::F;
    uint32_t hits = 0;
    for (uint32_t k = 0; k < kCpuLeaf; k += Simd::kWidth) {
        const Vec3<F> o = all_of(w.sheared_o, i);
        const uint64_t corner = 3 * count;
        const float *x = rows + w.axis[0][i] * count + k, *y = rows + w.axis[1][i] * count + k,
                    *z = rows + w.axis[2][i] * count + k;
        const Vec3<F> v[3] = {
            Vec3<F>{load(x, F()), load(y, F()), load(z, F())} - o,
            Vec3<F>{load(x + corner, F()), load(y + corner, F()), load(z + corner, F())} - o,
            Vec3<F>{load(x + 2 * corner, F()), load(y + 2 * corner, F()),
                    load(z + 2 * corner, F())} -
                o};
        const Shear<Simd> shear{{}, {}, F(w.shear[0][i]), F(w.shear[1][i])};
        hits |= bits(inside_sheared<Simd>(shear, v)) << k;
    }
    hits &= (1u << count) - 1u;
    for (uint32_t k = 0; k < kCpuLeaf; k += Simd::kWidth) {
        if (!(hits >> k)) break;
        const auto row = [&](uint32_t r) { return load(rows + r * count + k, F()); };
        const Vec3<F> v[3] = {
            {row(0), row(1), row(2)}, {row(3), row(4), row(5)}, {row(6), row(7), row(8)}};
        const Slabs<Simd> slabs{all_of(w.inverse, i), all_of(w.near, i), all_of(w.far, i)};
        const Ray<Simd> ray{all_of(w.o, i), all_of(w.d, i)};
        const Vec3<F> n{row(kRecordPlane), row(kRecordPlane + 1), row(kRecordPlane + 2)};
        const F height =
            fma(n.z, ray.o.z, fma(n.y, ray.o.y, fma(n.x, ray.o.x, row(kRecordPlane + 3))));
        const F at = bounded_distance<Simd>(-height / dot(n, ray.d), slabs, v);
        store(t + k, at);
        const auto ahead = (at > F(0.f)) & (at >= F(w.after[i])) & (at <= F(w.t[i]));
        hits &= ~(((1u << Simd::kWidth) - 1u) << k) | bits(ahead) << k;
    }
    if constexpr (kKinds != kTreeTriangles)
        hits = round_hits<kKinds>(rows, count, w, i, w.t[i], hits, t);
    return hits;
}

VR_HD void fetch(const void* p, uint32_t bytes) {
    for (uint32_t i = 0; i < bytes; i += 64) __builtin_prefetch(static_cast<const char*>(p) + i);
}

// One node or leaf of the traversal of ray i; returns whether it goes on. kAny: stop at any hit.
template <uint32_t kKinds, bool kAny, class L>
VR_HD bool step(const BvhView& bvh, Walkers<L>& w, uint32_t i) {
    const auto* nodes = static_cast<const WideNode<kCpuWidth>*>(bvh.nodes);
    const auto* blocks = static_cast<const RecordBlock*>(bvh.records);
    const uint32_t node = w.node[i];
    uint32_t next = kEmptyChild;
    if (node & kLeafFlag) {
        const float* rows = blocks[(node & ~kLeafFlag) >> 4].f;
        const uint32_t count = (node & 15u) + 1;
        float t[kCpuLeaf];
        for (uint32_t m = leaf_hits<kKinds>(rows, count, w, i, t); m; m &= m - 1) {
            const uint32_t j = static_cast<uint32_t>(__builtin_ctz(m));
            const uint32_t primitive = record_primitive(rows, count, j);
            if constexpr (kAny) {
                if (t[j] < w.t[i] && primitive != w.primitive[i]) return w.t[i] = -1.f, false;
            } else if (closer<Scalar>(t[j], primitive, {w.t[i], w.primitive[i]},
                                      {w.after[i], w.passed[i]})) {
                w.t[i] = t[j], w.primitive[i] = primitive;
            }
        }
    } else {
        const WideNode<kCpuWidth>& n = nodes[node];
        float entry[kCpuWidth];
        uint32_t hits = entered(n, w, i, entry);
        if (hits) {
            const auto key = [&] {
                const uint32_t k = static_cast<uint32_t>(__builtin_ctz(hits));
                hits &= hits - 1;
                return static_cast<uint64_t>(as_uint(entry[k])) << 32 | n.child[k];
            };
            uint64_t nearest = key();
            uint64_t* const base = w.stack[i] + w.waiting[i];
            uint64_t* top = base;
            {
                const bool two = hits != 0;
                const uint32_t k =
                    static_cast<uint32_t>(__builtin_ctz(hits | 1u << (kCpuWidth - 1)));
                hits &= hits - 1;
                const uint64_t other = static_cast<uint64_t>(as_uint(entry[k])) << 32 | n.child[k];
                const bool swap = !kAny && two && other < nearest;
                *top = swap ? nearest : other;
                nearest = swap ? other : nearest;
                top += two;
            }
            while (__builtin_expect(hits, 0)) {
                const uint64_t other = key();
                const bool swap = !kAny && other < nearest;
                const uint64_t farther = swap ? nearest : other;
                nearest = swap ? other : nearest;
                uint64_t* at = top++;
                if (!kAny)
                    for (; at > base && at[-1] < farther; --at) *at = at[-1];
                *at = farther;
            }
            w.waiting[i] += static_cast<uint32_t>(top - base);
            next = static_cast<uint32_t>(nearest);
        }
    }
    if (next == kEmptyChild) {
        uint32_t waiting = w.waiting[i];
        do {
            if (waiting == 0) return false;
            const uint64_t top = w.stack[i][--waiting];
            if (!(as_float(static_cast<uint32_t>(top >> 32)) > w.t[i]))
                next = static_cast<uint32_t>(top);
        } while (next == kEmptyChild);
        w.waiting[i] = waiting;
    }
    w.node[i] = next;
    if (next & kLeafFlag)
        fetch(&blocks[(next & ~kLeafFlag) >> 4], ((next & 15u) + 1) * 36);
    else
        fetch(&nodes[next], sizeof(WideNode<kCpuWidth>));
    return true;
}

// Rays `active`, in turn.
template <uint32_t kKinds, bool kAny, class L>
VR_CALLED void walk_in_turns(const BvhView& bvh, Walkers<L>& w, uint32_t active) {
    uint32_t on_way[L::kWidth], n = 0;
    for (uint32_t m = active; m; m &= m - 1) on_way[n++] = static_cast<uint32_t>(__builtin_ctz(m));
    while (n > 0)
        for (uint32_t i = 0; i < n;)
            if (step<kKinds, kAny>(bvh, w, on_way[i]))
                ++i;
            else
                on_way[i] = on_way[--n];
}

}  // namespace veriray
