// A tree of boxes over triangles, spheres and disks, and its traversal: one ray at a time on the
// CPU (lane after lane, eight or sixteen boxes or triangles at once), one ray per thread on CUDA.
//
// The closest hit does not depend on the tree. A primitive's test is one sequence of operations,
// however it is scheduled. Ties go to the primitive with the smaller number. No box is skipped that
// holds a primitive which counts: boxes are padded beyond the rounding of the tests, a box is
// skipped only if it starts beyond the closest hit, and no hit lies before its primitive's own box
// or counts if the ray misses that box (bounded_distance). Where `sah` splits a triangle, the boxes
// of its parts are smaller than its own. For rays that lie in its plane to within rounding, the
// distance is noise, so such a ray may meet a part after something behind it.
#pragma once

#include "geometry/disk.h"
#include "geometry/sphere.h"
#include "geometry/triangle.h"

namespace veriray {

inline constexpr uint32_t kLeafFlag = 0x80000000u;
inline constexpr uint32_t kEmptyChild = 0xffffffffu;
inline constexpr float kBoxPad = 0x1p-20f;   // normalised units
inline constexpr uint32_t kMaxLeaf = 16;     // records
inline constexpr uint32_t kDeviceWidth = 4;  // children of a node

// Kinds of primitives that a tree may hold: code for other kinds is not compiled.
enum TreeKinds : uint32_t {
    kTreeTriangles = 1,
    kTreeSpheres = 2,
    kTreeDisks = 4,
    kTreeAll = kTreeTriangles | kTreeSpheres | kTreeDisks
};

template <uint32_t N>
struct alignas(64) WideNode {
    float lo[3][N], hi[3][N];  // empty child: lo = infinity, hi = -infinity
    uint32_t child[N];         // a node, or kLeafFlag | first << 4 | count - 1
};

// A record is 16 floats: a triangle's corners and plane, the 8 floats of a sphere or the 12 of a
// disk; then primitive and kind as integers, and 0.
inline constexpr uint32_t kRecordFloats = 16, kRecordPlane = 9, kRecordId = 13, kRecordKind = 14;
enum RecordKind : uint32_t { kTriangleRecord = 0, kSphereRecord = 1, kDiskRecord = 2 };

// The CPU's leaves begin at a block and hold kLeafRows rows of `count` numbers, one row after
// another: the floats 0 to 12 of the records, then kRecordMark | kind << kRecordKindShift |
// primitive (a normal number when read as a float).
inline constexpr uint32_t kLeafRows = 14, kBlockFloats = 16;
inline constexpr uint32_t kRecordKindShift = 27, kRecordMark = 0x40000000u;
struct alignas(64) RecordBlock {
    float f[kBlockFloats];
};

// On a CPU the rays of larger trees, in bytes, take turns.
inline constexpr uint64_t kCachedTree = 1 << 25;

struct BvhView {
    const void* nodes;  // WideNode of kCpuWidth or kDeviceWidth; the root is the first
    const void*
        records;  // CPU: RecordBlock, `first` of a leaf counts blocks (scene/tree_layout.h).
                  // CUDA: kRecordFloats floats each, 16-byte aligned.
    float slack;  // for slabs_of
    // CPU: whether the tree has more than kCachedTree bytes; whether it holds spheres or discs.
    uint32_t large, round;
};

// ---- one primitive ----
using Scalar3 = Vec3<float>;

// Distances to a sphere or disk record beyond `last`; infinity where the ray misses it.
template <uint32_t kKinds, class L>
VR_HD typename L::F round_distance(const float* record, uint32_t kind, typename L::U primitive,
                                   const Ray<L>& ray, const Slabs<L>& slabs, const Hit<L>& last) {
    using F = typename L::F;
    F distance(kInfinity);
    if constexpr (kKinds & kTreeSpheres)
        if (!(kKinds & kTreeDisks) || kind == kSphereRecord) {
            F root[2], before(0.f);
            auto open = may_meet_sphere<L>(record, ray, F(kInfinity));
            if (none(open)) return distance;
            open = open & sphere_roots<L>(record, ray, root[0], root[1]);
            const Vec3<F> c = broadcast<F>(record), r{F(record[6]), F(record[6]), F(record[6])};
            const Vec3<F> v[3] = {c - r, c + r, c};
            for (const F at : root) {
                const auto ahead = open & (at > F(0.f));
                if (none(ahead)) continue;
                const F t = max(bounded_distance<L>(at, slabs, v), just_beyond(before));
                const auto take = ahead & beyond<L>(last, t, primitive);
                distance = select(take, t, distance);
                open = open & !take;
                before = select(ahead, t, before);
            }
        }
    if constexpr (kKinds & kTreeDisks)
        if (kind == kDiskRecord) {
            F t;
            const auto met = meets_disk<L>(record, ray, F(kInfinity), t);
            distance = select(met & beyond<L>(last, t, primitive), t, distance);
        }
    return distance;
}

// Whether a hit lies beyond `last` and before `hit`.
template <class L>
VR_HD typename L::M closer(typename L::F t, typename L::U primitive, const Hit<L>& hit,
                           const Hit<L>& last) {
    return beyond<L>(last, t, primitive) &
           ((t < hit.t) | ((t == hit.t) & (primitive < hit.primitive)));
}

}  // namespace veriray

#if VR_CUDA
#include "geometry/walk_scalar.h"
#else
#include "geometry/walk_batch.h"
#endif
