// CUDA's traversal: one ray per thread, nodes of 2, 4 or 8 boxes, near child first, records one by
// one.
#pragma once

#include "geometry/bvh.h"

namespace veriray {

// Size of the stack: N - 1 siblings can wait per level of the deepest tree.
template <uint32_t N>
inline constexpr uint32_t kWalkStack = (N - 1) * 64 + 1;

template <uint32_t N>
VR_HD void load_row(const float* p, float (&row)[N]) {
    if constexpr (N == 2) {
        const Pair<float> a = load2(p);
        row[0] = a.x, row[1] = a.y;
    } else {
        for (uint32_t k = 0; k < N; k += 4) {
            const Quad<float> a = load4(p + k);
            row[k] = a.x, row[k + 1] = a.y, row[k + 2] = a.z, row[k + 3] = a.w;
        }
    }
}

struct RayFrame {
    Ray<Scalar> ray;
    Slabs<Scalar> slabs;
    Shear<Scalar> shear;
};
VR_HD RayFrame frame_of(const BvhView& bvh, const Ray<Scalar>& ray) {
    return {ray, slabs_of<Scalar>(ray, bvh.slack), shear_of<Scalar>(ray.d)};
}

// The state of a traversal: the next node, or kWalkEnd, and the stack of nodes that wait. Their
// distances do not wait with them: to test the few nodes that have come to lie beyond the hit takes
// less time than a stack of twice the size.
inline constexpr uint32_t kWalkEnd = ~0u;
template <uint32_t N>
struct WalkPlace {
    uint32_t node, size;
    uint32_t stack[kWalkStack<N>];

    VR_HD void begin() { node = size = 0; }
    VR_HD bool walking() const { return node != kWalkEnd; }
    VR_HD bool at_node() const { return !(node & kLeafFlag); }
    VR_HD bool at_leaf() const { return !at_node() && walking(); }
    VR_HD void next_waiting() { node = size ? stack[--size] : kWalkEnd; }
};

// Goes from a node to its nearest child that the ray reaches within t; the others wait.
template <uint32_t N>
VR_HD void walk_node(const BvhView& bvh, const Slabs<Scalar>& s, float after, float t,
                     WalkPlace<N>& place) {
    const float* rows = static_cast<const WideNode<N>*>(bvh.nodes)[place.node].lo[0];
    const uint32_t flip_x = s.inverse.x < 0.f ? 3 * N : 0, flip_y = s.inverse.y < 0.f ? 3 * N : 0,
                   flip_z = s.inverse.z < 0.f ? 3 * N : 0;
    float x0[N], x1[N], y0[N], y1[N], z0[N], z1[N], child[N], entry[N];
    load_row<N>(rows + flip_x, x0), load_row<N>(rows + 3 * N - flip_x, x1);
    load_row<N>(rows + N + flip_y, y0), load_row<N>(rows + 4 * N - flip_y, y1);
    load_row<N>(rows + 2 * N + flip_z, z0), load_row<N>(rows + 5 * N - flip_z, z1);
    load_row<N>(rows + 6 * N, child);
    for (uint32_t k = 0; k < N; ++k) {
        const float near =
            max(max(fma(x0[k], s.inverse.x, s.near.x), fma(y0[k], s.inverse.y, s.near.y)),
                max(fma(z0[k], s.inverse.z, s.near.z), after));
        const float far =
            min(min(fma(x1[k], s.inverse.x, s.far.x), fma(y1[k], s.inverse.y, s.far.y)),
                min(fma(z1[k], s.inverse.z, s.far.z), t));
        entry[k] = near <= far ? near : kInfinity;
    }
    // A sorting network: near children first, missed boxes last.
    const auto order = [&](uint32_t a, uint32_t b) {
        const bool swap = entry[b] < entry[a];
        const float e = swap ? entry[b] : entry[a], c = swap ? child[b] : child[a];
        entry[b] = swap ? entry[a] : entry[b], child[b] = swap ? child[a] : child[b];
        entry[a] = e, child[a] = c;
    };
    if constexpr (N == 2) {
        order(0, 1);
    } else if constexpr (N == 4) {
        order(0, 2), order(1, 3), order(0, 1), order(2, 3), order(1, 2);
    } else {
        order(0, 2), order(1, 3), order(4, 6), order(5, 7);
        order(0, 4), order(1, 5), order(2, 6), order(3, 7);
        order(0, 1), order(2, 3), order(4, 5), order(6, 7);
        order(2, 4), order(3, 5);
        order(1, 4), order(3, 6);
        order(1, 2), order(3, 4), order(5, 6);
    }
    if (!(entry[0] < kInfinity)) return place.next_waiting();
    for (uint32_t k = N - 1; k > 0; --k)
        if (entry[k] < kInfinity) place.stack[place.size++] = as_uint(child[k]);
    place.node = as_uint(child[0]);
}

// Distance at which the ray meets a record, and the record's primitive; infinity or 0 for a miss.
template <uint32_t kKinds>
VR_HD float record_distance(const float* record, const RayFrame& f, const Hit<Scalar>& last,
                            uint32_t& primitive) {
    const Quad<float> a = load4(record), b = load4(record + 4), c = load4(record + 8);
    if constexpr (kKinds != kTreeTriangles) {
        const Quad<float> d = load4(record + 12);
        primitive = as_uint(d.y);
        if (!(kKinds & kTreeTriangles) || as_uint(d.z) != kTriangleRecord) {
            const float all[12] = {a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c.x, c.y, c.z, c.w};
            return round_distance<kKinds, Scalar>(all, as_uint(d.z), primitive, f.ray, f.slabs,
                                                  last);
        }
    }
    const Scalar3 v[3] = {{a.x, a.y, a.z}, {a.w, b.x, b.y}, {b.z, b.w, c.x}};
    const auto seen = [&](Scalar3 p) {
        return main_axis_last(f.shear.from_x, f.shear.from_y, p - f.ray.o);
    };
    const Scalar3 w[3] = {seen(v[0]), seen(v[1]), seen(v[2])};
    if (!inside_sheared<Scalar>(f.shear, w)) return kInfinity;
    const Quad<float> d = load4(record + 12);
    primitive = as_uint(d.y);
    const float plane[4] = {c.y, c.z, c.w, d.x};
    return bounded_distance<Scalar>(plane_distance<Scalar>(plane, f.ray), f.slabs, v);
}

// What a ray looks for: the closest hit beyond `last`, or any with a primitive other than `skip`.
struct WalkAim {
    bool any;
    uint32_t skip;
    Hit<Scalar> last;
};

// Tests the records of the leaf that the traversal has reached, and goes on.
template <uint32_t N, uint32_t kKinds>
VR_HD void walk_leaf(const BvhView& bvh, const RayFrame& f, WalkAim aim, Hit<Scalar>& hit,
                     WalkPlace<N>& place) {
    const float* record = static_cast<const float*>(bvh.records) +
                          static_cast<uint64_t>((place.node & ~kLeafFlag) >> 4) * kRecordFloats;
    for (uint32_t count = (place.node & 15u) + 1u; count; --count, record += kRecordFloats) {
        uint32_t primitive = ~0u;
        const float t = record_distance<kKinds>(record, f, aim.last, primitive);
        if (!aim.any) {
            if (t < kInfinity && closer<Scalar>(t, primitive, hit, aim.last)) hit = {t, primitive};
        } else if (t > 0.f && t < hit.t && primitive != aim.skip) {
            hit = {t, primitive};
            place.node = kWalkEnd;
            return;
        }
    }
    place.next_waiting();
}

template <uint32_t N, uint32_t kKinds>
VR_HD void walk(const BvhView& bvh, const Ray<Scalar>& ray, WalkAim aim, Hit<Scalar>& hit) {
    const RayFrame f = frame_of(bvh, ray);
    WalkPlace<N> place;
    place.begin();
    while (place.walking()) {
        while (place.at_node()) walk_node<N>(bvh, f.slabs, aim.last.t, hit.t, place);
        if (place.at_leaf()) walk_leaf<N, kKinds>(bvh, f, aim, hit, place);
    }
}

template <uint32_t N, uint32_t kKinds>
VR_HD void closest_in_width(const BvhView& bvh, const Ray<Scalar>& ray, const Hit<Scalar>& last,
                            Hit<Scalar>& hit) {
    walk<N, kKinds>(bvh, ray, {false, ~0u, last}, hit);
}

template <class L, uint32_t kKinds>
VR_HD void closest_in_bvh(const BvhView& bvh, const Ray<L>& ray, const Hit<L>& last, bool active,
                          Hit<L>& hit) {
    if (active) closest_in_width<kDeviceWidth, kKinds>(bvh, ray, last, hit);
}

// Whether the ray meets a primitive other than `skip` before t_max.
template <class L, uint32_t kKinds>
VR_HD bool occluded_in_bvh(const BvhView& bvh, const Ray<L>& ray, float t_max, bool active,
                           uint32_t skip) {
    Hit<Scalar> hit{t_max, ~0u};
    if (active) walk<kDeviceWidth, kKinds>(bvh, ray, {true, skip, nothing_met<L>()}, hit);
    return hit.t < t_max;
}

}  // namespace veriray
