// The walk of the CPU: one ray through nodes of eight boxes and leaves of blocks of eight records.
// I. Wald, C. Benthin, S. Boulos, "Getting Rid of Packets", RT 2008.
#pragma once

#include "geometry/bvh.h"

namespace veriray {

// A ray in all elements of a batch.
struct BatchRay {
    using F = Batch::F;
    Slabs<Batch> slabs;
    Shear<Batch> shear;
    Ray<Batch> ray;
    Vec3<F> o;                                  // main axis last
    uint32_t near_row[3], far_row[3], x, y, z;  // rows of a node; axes of o
};

VR_HD Vec3<Batch::F> all_of(Vec3<float> v) { return {Batch::F(v.x), Batch::F(v.y), Batch::F(v.z)}; }

VR_HD BatchRay batch_ray(const RayFrame& f) {
    using F = Batch::F;
    BatchRay r;
    r.slabs = {all_of(f.slabs.inverse), all_of(f.slabs.near), all_of(f.slabs.far)};
    r.shear.x = F(f.shear.x), r.shear.y = F(f.shear.y);
    r.ray = {all_of(f.ray.o), all_of(f.ray.d)};
    r.o = all_of(main_axis_last(f.shear.from_x, f.shear.from_y, f.ray.o));
    const float inverse[3] = {f.slabs.inverse.x, f.slabs.inverse.y, f.slabs.inverse.z};
    for (uint32_t k = 0; k < 3; ++k) {
        r.near_row[k] = inverse[k] < 0.f ? 3 + k : k;
        r.far_row[k] = 3 + k - r.near_row[k] + k;
    }
    r.x = f.shear.from_x ? 2 : 0;
    r.y = f.shear.from_y ? 2 : 1;
    r.z = f.shear.from_x ? 0 : f.shear.from_y ? 1 : 2;
    return r;
}

// Children whose boxes the ray enters within t, as bits, and where.
VR_HD uint32_t entered(const WideNode<kCpuWidth>& node, const BatchRay& r, float t,
                       float (&entry)[kCpuWidth]) {
    using F = Batch::F;
    const float* rows = node.lo[0];
    uint32_t hits = 0;
    for (uint32_t k = 0; k < kCpuWidth; k += Batch::kWidth) {
        const auto plane = [&](uint32_t row, F inverse, F shift) {
            return fma(load(rows + row * kCpuWidth + k, F()), inverse, shift);
        };
        const Slabs<Batch>& s = r.slabs;
        const F near = max(max(plane(r.near_row[0], s.inverse.x, s.near.x),
                               plane(r.near_row[1], s.inverse.y, s.near.y)),
                           max(plane(r.near_row[2], s.inverse.z, s.near.z), F(0.f)));
        const F far = min(min(plane(r.far_row[0], s.inverse.x, s.far.x),
                              plane(r.far_row[1], s.inverse.y, s.far.y)),
                          min(plane(r.far_row[2], s.inverse.z, s.far.z), F(t)));
        store(entry + k, near);
        hits |= bits(near <= far) << k;
    }
    return hits;
}

// Records of a block that the ray meets, as bits, and where.
template <uint32_t kKinds>
VR_HD uint32_t block_hits(const RecordBlock& block, const RayFrame& f, const BatchRay& r,
                          float t_max, float (&t)[kBlock]) {
    using F = Batch::F;
    uint32_t hits = 0;
    for (uint32_t k = 0; k < kBlock; k += Batch::kWidth) {
        const auto row = [&](uint32_t i) { return load(block.rows[i] + k, F()); };
        Vec3<F> v[3];
        for (uint32_t i = 0; i < 3; ++i)
            v[i] = Vec3<F>{row(3 * i + r.x), row(3 * i + r.y), row(3 * i + r.z)} - r.o;
        const Batch::M inside = inside_sheared<Batch>(r.shear, v);
        if (none(inside)) continue;
        for (uint32_t i = 0; i < 3; ++i) v[i] = {row(3 * i), row(3 * i + 1), row(3 * i + 2)};
        const Vec3<F> n{row(kRecordPlane), row(kRecordPlane + 1), row(kRecordPlane + 2)};
        const F height =
            fma(n.z, r.ray.o.z, fma(n.y, r.ray.o.y, fma(n.x, r.ray.o.x, row(kRecordPlane + 3))));
        const F at = bounded_distance<Batch>(-height / dot(n, r.ray.d), r.slabs, v);
        store(t + k, at);
        hits |= bits(inside & (at > F(0.f)) & (at <= F(t_max))) << k;
    }
    if constexpr (kKinds != kTreeTriangles)
        for (uint32_t i = 0; i < kBlock; ++i) {
            const uint32_t kind = as_uint(block.rows[kRecordKind][i]);
            if (kind == kTriangleRecord) continue;
            float record[12];
            for (uint32_t c = 0; c < 12; ++c) record[c] = block.rows[c][i];
            t[i] = round_distance<kKinds>(record, kind, f);
            hits = (hits & ~(1u << i)) | (t[i] <= t_max && t[i] < kInfinity ? 1u << i : 0u);
        }
    return hits;
}

inline constexpr uint32_t kCpuStack = 7 * 64 + 1;  // seven siblings a level of the deepest tree

// Calls leaf(first, count) for the leaves that the ray reaches within t, which leaf may lower;
// until it returns true. kSorted: near first.
template <bool kSorted, class Leaf>
VR_HD void walk(const BvhView& bvh, const BatchRay& r, const float& t, Leaf leaf) {
    const auto* nodes = static_cast<const WideNode<kCpuWidth>*>(bvh.nodes);
    uint64_t stack[kCpuStack];  // bits of the entry distance, child
    uint32_t size = 0, node = 0;
    for (;;) {
        while (!(node & kLeafFlag)) {
            const WideNode<kCpuWidth>& n = nodes[node];
            float entry[kCpuWidth];
            uint32_t hits = entered(n, r, t, entry);
            const auto next = [&] {
                const uint32_t i = static_cast<uint32_t>(__builtin_ctz(hits));
                hits &= hits - 1;
                return static_cast<uint64_t>(as_uint(entry[i])) << 32 | n.child[i];
            };
            if (!hits) break;
            uint64_t nearest = next();
            const uint32_t base = size;
            while (hits) {
                uint64_t other = next();
                const bool swap = kSorted && other < nearest;
                const uint64_t farther = swap ? nearest : other;
                nearest = swap ? other : nearest;
                uint32_t at = size++;
                if (kSorted)
                    for (; at > base && stack[at - 1] < farther; --at) stack[at] = stack[at - 1];
                stack[at] = farther;
            }
            node = static_cast<uint32_t>(nearest);
        }
        if ((node & kLeafFlag) && leaf((node & ~kLeafFlag) >> 4, (node & 15u) + 1u)) return;
        do {
            if (size == 0) return;
            node = static_cast<uint32_t>(stack[--size]);
        } while (as_float(static_cast<uint32_t>(stack[size] >> 32)) > t);
    }
}

template <uint32_t kKinds>
VR_HD void closest_of_ray(const BvhView& bvh, const Ray<Scalar>& ray, Hit<Scalar>& hit) {
    const RayFrame f = frame_of(ray);
    const BatchRay r = batch_ray(f);
    const auto* blocks = static_cast<const RecordBlock*>(bvh.records);
    walk<true>(bvh, r, hit.t, [&](uint32_t first, uint32_t count) {
        for (uint32_t b = first; b < first + count; ++b) {
            const RecordBlock& block = blocks[b];
            float t[kBlock];
            for (uint32_t hits = block_hits<kKinds>(block, f, r, hit.t, t); hits;
                 hits &= hits - 1) {
                const uint32_t i = static_cast<uint32_t>(__builtin_ctz(hits));
                const uint32_t primitive = as_uint(block.rows[kRecordId][i]);
                if (closer(t[i], primitive, hit)) hit = {t[i], primitive};
            }
        }
        return false;
    });
}

template <uint32_t kKinds>
VR_HD bool occluded_ray(const BvhView& bvh, const Ray<Scalar>& ray, float t_max, uint32_t skip) {
    const RayFrame f = frame_of(ray);
    const BatchRay r = batch_ray(f);
    const auto* blocks = static_cast<const RecordBlock*>(bvh.records);
    bool blocked = false;
    walk<false>(bvh, r, t_max, [&](uint32_t first, uint32_t count) {
        for (uint32_t b = first; b < first + count; ++b) {
            const RecordBlock& block = blocks[b];
            float t[kBlock];
            for (uint32_t hits = block_hits<kKinds>(block, f, r, t_max, t); hits;
                 hits &= hits - 1) {
                const uint32_t i = static_cast<uint32_t>(__builtin_ctz(hits));
                blocked |= t[i] < t_max && as_uint(block.rows[kRecordId][i]) != skip;
            }
            if (blocked) break;
        }
        return blocked;
    });
    return blocked;
}

// ---- lanes, one after another ----
template <class L>
struct LaneRays {
    float o[3][L::kWidth], d[3][L::kWidth];

    VR_HD explicit LaneRays(const Ray<L>& ray) {
        store(o[0], ray.o.x), store(o[1], ray.o.y), store(o[2], ray.o.z);
        store(d[0], ray.d.x), store(d[1], ray.d.y), store(d[2], ray.d.z);
    }
    VR_HD Ray<Scalar> operator[](uint32_t i) const {
        return {{o[0][i], o[1][i], o[2][i]}, {d[0][i], d[1][i], d[2][i]}};
    }
};

template <class L, uint32_t kKinds>
VR_HD void closest_in_bvh(const BvhView& bvh, const Ray<L>& ray, typename L::M active,
                          Hit<L>& hit) {
    const LaneRays<L> rays(ray);
    float t[L::kWidth];
    uint32_t primitive[L::kWidth];
    store(t, hit.t), store(primitive, hit.primitive);
    for (uint32_t m = bits(active); m; m &= m - 1) {
        const uint32_t i = static_cast<uint32_t>(__builtin_ctz(m));
        Hit<Scalar> one{t[i], primitive[i]};
        closest_of_ray<kKinds>(bvh, rays[i], one);
        t[i] = one.t, primitive[i] = one.primitive;
    }
    hit.t = load(t, typename L::F()), hit.primitive = load(primitive, typename L::U());
}

// Lanes of `active` that meet a primitive other than `skip` before t_max.
template <class L, uint32_t kKinds>
VR_HD typename L::M occluded_in_bvh(const BvhView& bvh, const Ray<L>& ray, typename L::F t_max,
                                    typename L::M active, typename L::U skip) {
    const LaneRays<L> rays(ray);
    float t[L::kWidth];
    uint32_t not_this[L::kWidth], blocked = 0;
    store(t, t_max), store(not_this, skip);
    for (uint32_t m = bits(active); m; m &= m - 1) {
        const uint32_t i = static_cast<uint32_t>(__builtin_ctz(m));
        blocked |= (occluded_ray<kKinds>(bvh, rays[i], t[i], not_this[i]) ? 1u : 0u) << i;
    }
    return mask_of(blocked, typename L::M());
}

}  // namespace veriray
