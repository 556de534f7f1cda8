// A binary bounding volume hierarchy over triangles and its walk, for one ray or a packet of lanes.
// The closest hit does not depend on the tree: boxes are padded beyond the rounding of the triangle
// test, and ties go to the smaller triangle.
#pragma once

#include "geometry/triangle.h"

namespace veriray {

inline constexpr uint32_t kLeafFlag = 0x80000000u;
inline constexpr uint32_t kLeafTriangles = 4;  // at most; count - 1 in the two low bits
inline constexpr uint32_t kBvhStack = 64;
inline constexpr float kBoxPad = 0x1p-20f;  // normalised units

struct BvhNode {
    float lo[2][3], hi[2][3];
    uint32_t child[2];  // a node, or kLeafFlag | first << 2 | count - 1
};

struct BvhView {
    const BvhNode* nodes;  // nodes[0] is the root
    const float* triangles;
    const uint32_t* order;  // leaf slot -> primitive
};

template <class L>
struct BoxRay {
    Vec3<typename L::F> o, inverse;
};

// 1 / d, held finite so that 0 times it stays 0 on a slab's face.
template <class F>
VR_HD F finite_inverse(F d) {
    return select(abs(d) < F(0x1p-100f), F(0x1p100f), F(1.f) / d);
}

// Entry distance into a padded box; infinite where it is missed or lies beyond t.
template <class L>
VR_HD typename L::F box_entry(const float* lo, const float* hi, const BoxRay<L>& r,
                              typename L::F t) {
    using F = typename L::F;
    F near(0.f), far = t;
    const F o[3] = {r.o.x, r.o.y, r.o.z}, inv[3] = {r.inverse.x, r.inverse.y, r.inverse.z};
    for (int k = 0; k < 3; ++k) {
        const F a = (F(lo[k]) - o[k]) * inv[k], b = (F(hi[k]) - o[k]) * inv[k];
        near = max(select(a < b, a, b), near);
        far = min(select(a < b, b, a), far);
    }
    // 4 ulp for the two roundings a side; plus 2^-18 for the distance of the plane in `t`.
    return select(near <= far * F(1.f + 0x1p-18f), near, F(kInfinity));
}

// Calls leaf(first, count) for the leaves that lanes of `active` reach within limit(), near first.
template <class L, class Limit, class Leaf>
VR_HD void walk(const BvhView& bvh, const Ray<L>& ray, typename L::M active, Limit limit,
                Leaf leaf) {
    using F = typename L::F;
    const BoxRay<L> r{ray.o,
                      {finite_inverse(ray.d.x), finite_inverse(ray.d.y), finite_inverse(ray.d.z)}};
    uint32_t stack[kBvhStack], size = 0, node = 0;
    for (;;) {
        if (node & kLeafFlag) {
            if (leaf((node & ~kLeafFlag) >> 2, (node & 3u) + 1u)) return;
        } else {
            const BvhNode& n = bvh.nodes[node];
            const F t = limit();
            const F near0 = box_entry<L>(n.lo[0], n.hi[0], r, t);
            const F near1 = box_entry<L>(n.lo[1], n.hi[1], r, t);
            const auto hit0 = active & (near0 < F(kInfinity));
            const auto hit1 = active & (near1 < F(kInfinity));
            if (any(hit0) && any(hit1)) {
                const bool first = count(hit0 & (near0 <= near1)) >= count(hit1 & (near1 < near0));
                stack[size++] = n.child[first ? 1 : 0];
                node = n.child[first ? 0 : 1];
                continue;
            }
            if (any(hit0) || any(hit1)) {
                node = n.child[any(hit0) ? 0 : 1];
                continue;
            }
        }
        if (size == 0) return;
        node = stack[--size];
    }
}

template <class L>
VR_HD void closest_in_bvh(const BvhView& bvh, const Ray<L>& ray, typename L::M active,
                          Hit<L>& hit) {
    const Projection<L> pr = projection<L>(ray.d);
    walk<L>(
        bvh, ray, active, [&] { return hit.t; },
        [&](uint32_t first, uint32_t n) {
            for (uint32_t i = first; i < first + n; ++i) {
                const float* tri = bvh.triangles + static_cast<uint64_t>(i) * kTriangleFloats;
                const auto inside = inside_triangle<L>(tri, ray, pr);
                if (any(inside))
                    keep_closest<L>(hit, inside, plane_distance<L>(tri + 9, ray), bvh.order[i]);
            }
            return false;
        });
}

// Lanes of `active` that meet a triangle before t_max; ends when all have.
template <class L>
VR_HD typename L::M occluded_in_bvh(const BvhView& bvh, const Ray<L>& ray, typename L::F t_max,
                                    typename L::M active) {
    using F = typename L::F;
    const Projection<L> pr = projection<L>(ray.d);
    typename L::M blocked = active & !active;
    walk<L>(
        bvh, ray, active, [&] { return select(blocked, F(-1.f), t_max); },
        [&](uint32_t first, uint32_t n) {
            for (uint32_t i = first; i < first + n; ++i) {
                const float* tri = bvh.triangles + static_cast<uint64_t>(i) * kTriangleFloats;
                const auto inside = inside_triangle<L>(tri, ray, pr);
                const F t = plane_distance<L>(tri + 9, ray);
                blocked = blocked | (active & inside & (t > F(0.f)) & (t < t_max));
            }
            return none(active & !blocked);
        });
    return blocked;
}

}  // namespace veriray
