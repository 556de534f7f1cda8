// The CPU's traversal for rays side by side: where they have their main axis in common and spread
// little, all go through the tree together. The boxes of a node are tested against the hull
// of the rays, and what remains, as the triangles of a leaf, one after another against all rays.
// A. Reshetov, A. Soupikov, J. Hurley, "Multi-Level Ray Tracing Algorithm", SIGGRAPH 2005.
#pragma once

#include "geometry/walk_turns.h"

namespace veriray {

// Rays spread at most so far: largest differences of origins and of slopes, in sum. At least so
// many.
inline constexpr float kPacketSpread = 0.5f;
inline constexpr uint32_t kPacketRays = 4;

template <class L>
struct Packet {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using B = Simd::F;
    const Ray<L>& ray;
    const Hit<L>& last;
    const Slabs<L>& slabs;
    const Shear<L>& shear;
    Vec3<F> sheared_o;
    M active;
    uint32_t axis[3];       // main axis last
    float sign;             // of the rays' direction along it
    float near, far;        // the last and the first origin along the direction
    float least_inverse;    // of the main axis
    float low[2], high[2];  // of the origins, across the main axis
    float slope[2][2];      // least and largest, across per distance along the main axis
    float most;             // of the rays' t
    bool together;          // whether the rays may go together

    VR_HD Packet(const BvhView& bvh, const Ray<L>& r, const Hit<L>& after, const Slabs<L>& s,
                 const Shear<L>& h, F t, M lanes)
        : ray(r), last(after), slabs(s), shear(h), active(lanes), together(false) {
        const uint32_t all = bits(lanes), x = bits(h.from_x & lanes), y = bits(h.from_y & lanes);
        if (count(lanes) < kPacketRays || (x && x != all) || (y && y != all)) return;
        const Vec3<F> d = main_axis_last(h.from_x, h.from_y, r.d);
        const uint32_t down = bits((d.z < F(0.f)) & lanes);
        if (down && down != all) return;
        sign = down ? -1.f : 1.f;
        sheared_o = main_axis_last(h.from_x, h.from_y, r.o);
        axis[0] = x ? 2u : 0u, axis[1] = y ? 2u : 1u, axis[2] = x ? 0u : y ? 1u : 2u;
        const auto least_of = [&](F a) { return least(select(lanes, a, F(kInfinity))); };
        const auto most_of = [&](F a) { return greatest(select(lanes, a, F(-kInfinity))); };
        const F across[2] = {sheared_o.x, sheared_o.y}, shears[2] = {h.x, h.y};
        float spread = 0.f, size = 1.f;
        for (int k = 0; k < 2; ++k) {
            const F s1 = shears[k] * F(-sign);
            low[k] = least_of(across[k]), high[k] = most_of(across[k]);
            slope[k][0] = least_of(s1), slope[k][1] = most_of(s1);
            spread = max(spread, high[k] - low[k] + (slope[k][1] - slope[k][0]));
            size = max(size, max(abs(low[k]), abs(high[k])));
        }
        if (!(spread <= kPacketSpread)) return;
        const F along = sheared_o.z * F(sign);
        near = most_of(along), far = least_of(along);
        size = max(size, max(abs(near), abs(far)));
        // In units of place: each ray has a slack of its own in its slabs. Rounding there is at
        // most 6 * 2^-23 of the size, and here 3 * 2^-23 (boxes lie within 1 of the origin, and
        // slopes are at most 1): less than two slacks more.
        const float slack = 3.f * bvh.slack * size;
        near += slack, far -= slack;
        for (int k = 0; k < 2; ++k) low[k] -= slack, high[k] += slack;
        least_inverse = 1.f / most_of(abs(d.z)) * (1.f - 0x1p-22f);
        most = greatest(select(lanes, t, F(0.f)));
        together = true;
    }

    // Children whose boxes the hull of the rays meets before `most`, as bits, and distances
    // that are not beyond where any ray enters.
    VR_HD uint32_t entered(const WideNode<kCpuWidth>& node, float (&entry)[kCpuWidth]) const {
        const float *lo = node.lo[0], *hi = node.hi[0];
        const float* ahead = sign < 0.f ? hi : lo;
        const float* behind = sign < 0.f ? lo : hi;
        uint32_t hits = 0;
        for (uint32_t k = 0; k < kCpuWidth; k += Simd::kWidth) {
            const B from =
                max(fma(load(ahead + axis[2] * kCpuWidth + k, B()), B(sign), B(-near)), B(0.f));
            const B to = fma(load(behind + axis[2] * kCpuWidth + k, B()), B(sign), B(-far));
            const B in = from * B(least_inverse);
            auto met = (from <= to) & (in <= B(most));
            for (int a = 0; a < 2; ++a) {
                const uint32_t row = axis[a] * kCpuWidth + k;
                const B least_at = fma(to, B(min(slope[a][0], 0.f)),
                                       fma(from, B(max(slope[a][0], 0.f)), B(low[a])));
                const B most_at = fma(to, B(max(slope[a][1], 0.f)),
                                      fma(from, B(min(slope[a][1], 0.f)), B(high[a])));
                met = met & (least_at <= load(hi + row, B())) & (load(lo + row, B()) <= most_at);
            }
            store(entry + k, in);
            hits |= bits(met) << k;
        }
        return hits;
    }

    // Whether a ray enters the box of child k before its t.
    VR_HD bool enters(const WideNode<kCpuWidth>& node, uint32_t k, F t) const {
        const auto at = [&](int a, F inverse, F start) {
            return Vec3<F>{fma(F(node.lo[a][k]), inverse, start),
                           fma(F(node.hi[a][k]), inverse, start), F(0.f)};
        };
        F in = last.t, out = t;
        const F inverse[3] = {slabs.inverse.x, slabs.inverse.y, slabs.inverse.z},
                near_start[3] = {slabs.near.x, slabs.near.y, slabs.near.z},
                far_start[3] = {slabs.far.x, slabs.far.y, slabs.far.z};
        for (int a = 0; a < 3; ++a) {
            const Vec3<F> first = at(a, inverse[a], near_start[a]),
                          second = at(a, inverse[a], far_start[a]);
            in = max(in, min(first.x, first.y));
            out = min(out, max(second.x, second.y));
        }
        return any((in <= out) & active);
    }

    // Rays that may meet record j of a leaf within t, and where.
    template <uint32_t kKinds>
    VR_HD M meets(const float* rows, uint32_t count, uint32_t j, U id, F t, F& at) const {
        const auto row = [&](uint32_t c) { return F(rows[c * count + j]); };
        M met = active;
        if (kKinds == kTreeTriangles || record_kind(rows, count, j) == kTriangleRecord) {
            Vec3<F> v[3];
            for (uint32_t c = 0; c < 3; ++c)
                v[c] = Vec3<F>{row(axis[0] + 3 * c), row(axis[1] + 3 * c), row(axis[2] + 3 * c)} -
                       sheared_o;
            met = met & inside_sheared<L>(shear, v);
            if (none(met)) return met;
            for (uint32_t c = 0; c < 3; ++c) v[c] = {row(3 * c), row(3 * c + 1), row(3 * c + 2)};
            const Vec3<F> n{row(kRecordPlane), row(kRecordPlane + 1), row(kRecordPlane + 2)};
            const F height =
                fma(n.z, ray.o.z, fma(n.y, ray.o.y, fma(n.x, ray.o.x, row(kRecordPlane + 3))));
            at = bounded_distance<L>(-height / dot(n, ray.d), slabs, v);
        } else {
            float record[12];
            for (uint32_t c = 0; c < 12; ++c) record[c] = rows[c * count + j];
            at = round_distance<kKinds, L>(record, record_kind(rows, count, j), id, ray, slabs,
                                           last);
        }
        return met & (at > F(0.f)) & (at >= last.t) & (at <= t) & (at < F(kInfinity));
    }
};

// The closest hits of a packet.
template <uint32_t kKinds, class L>
VR_CALLED void walk_together(const BvhView& bvh, Packet<L>& p, Hit<L>& hit) {
    using F = typename L::F;
    using U = typename L::U;
    const auto* nodes = static_cast<const WideNode<kCpuWidth>*>(bvh.nodes);
    const auto* blocks = static_cast<const RecordBlock*>(bvh.records);
    uint64_t stack[kCpuStack];  // as that of WalkStack
    uint64_t* top = stack;
    *top++ = 0;
    while (top != stack) {
        const uint64_t entry = *--top;
        if (as_float(static_cast<uint32_t>(entry >> 32)) > p.most) continue;
        const uint32_t next = static_cast<uint32_t>(entry);
        if (next & kLeafFlag) {
            const float* rows = blocks[(next & ~kLeafFlag) >> 4].f;
            const uint32_t count = (next & 15u) + 1;
            for (uint32_t j = 0; j < count; ++j) {
                F at;
                const U id(record_primitive(rows, count, j));
                auto take = p.template meets<kKinds>(rows, count, j, id, hit.t, at);
                if (none(take)) continue;
                take = take & closer<L>(at, id, hit, p.last);
                hit.t = select(take, at, hit.t);
                hit.primitive = select(take, id, hit.primitive);
            }
            p.most = greatest(select(p.active, hit.t, F(0.f)));
        } else {
            const WideNode<kCpuWidth>& n = nodes[next];
            float in[kCpuWidth];
            uint64_t* const base = top;
            for (uint32_t m = p.entered(n, in); m; m &= m - 1) {
                const uint32_t k = static_cast<uint32_t>(__builtin_ctz(m));
                if (!p.enters(n, k, hit.t)) continue;
                const uint64_t key = static_cast<uint64_t>(as_uint(in[k])) << 32 | n.child[k];
                uint64_t* at = top++;
                for (; at > base && at[-1] < key; --at) *at = at[-1];
                *at = key;
            }
        }
    }
}

}  // namespace veriray
