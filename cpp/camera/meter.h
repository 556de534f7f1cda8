// Rays that begin at, or go to, points of a shape of the scene that are even over its area.
#pragma once

#include "core/intervals.h"
#include "core/mapping.h"
#include "geometry/ray.h"

namespace veriray {

enum class MeterKind : uint32_t {
    kNone,
    kIrradiance,  // they leave the front by the cosine, and count pi times
    kDistant,     // they come along the camera's axis from outside of the scene
};
enum class PatchKind : uint32_t { kTriangle, kParallelogram, kDisk, kSphere };

// A patch: a point and its kind; an axis and what a ray counts; another axis, which of spheres
// begins with 1 or -1, the side of the front, and of which the first begins with the radius; of
// flat ones behind it n.p on its plane; the normal of the front and how far before the patch rays
// begin, as paths that leave the surface do, or 0: by the bound at the point.
inline constexpr uint32_t kPatchFloats = 16;

struct MeterView {
    MeterKind kind;
    uint32_t count, bits;    // patches; see core/intervals.h
    float across, down;      // a pixel, in films
    const float* patches;    // interval ends by area, then [patch][kPatchFloats]
    const uint32_t* guides;  // of the intervals
};

template <class L>
struct MeterRay {
    Ray<L> ray;
    typename L::F weight;
};

// x, y: on the film, in pixels. They say where on the shape, as Mitsuba's do: y which patch and,
// with x, where on it. u, v: of the direction. ahead: the camera's axis.
template <class L>
VR_HD MeterRay<L> meter_ray(const MeterView& m, Vec3<typename L::F> ahead, typename L::F x,
                            typename L::F y, typename L::F u, typename L::F v) {
    using F = typename L::F;
    using U = typename L::U;
    const F zero(0.f), one(1.f), most(0x1.fffffep-1f);
    const F s = min(x * F(m.across), most);
    F t;
    const Intervals<L> areas{m.patches, U(0u)};
    const U patch = areas.choose(m.guides, U(0u), m.bits, min(y * F(m.down), most), t);
    const U row = U(m.count) + (patch << 4);
    const auto number = [&](uint32_t k) { return gather(m.patches + k, row); };
    const auto vector = [&](uint32_t k) {
        return Vec3<F>{number(k), number(k + 1), number(k + 2)};
    };
    const auto is = [&](PatchKind k) { return number(3) == F(static_cast<float>(k)); };
    const Vec3<F> o = vector(0), a = vector(4), b = vector(8);
    // P. Shirley, K. Chiu, "A Low Distortion Map Between Disk and Square", 1997
    const F left = fma(s, F(2.f), F(-1.f)), up = fma(t, F(2.f), F(-1.f));
    const auto steep = abs(left) < abs(up);
    const F far = select(steep, up, left), near = select(steep, left, up);
    const F eighths = near / select(far == zero, one, far) * F(0.125f);
    const F turn = select(steep, F(0.25f) - eighths, select(eighths < zero, one, zero) + eighths);
    F sine, cosine;
    sincos_2pi(min(turn, most), sine, cosine);
    const F root = sqrt(one - s);
    const F along_a =
        select(is(PatchKind::kTriangle), one - root, select(is(PatchKind::kDisk), far * cosine, s));
    const F along_b =
        select(is(PatchKind::kTriangle), root * t, select(is(PatchKind::kDisk), far * sine, t));
    sincos_2pi(s, sine, cosine);
    const F z = fma(t, F(-2.f), one), around = sqrt(max(fma(-z, z, one), zero));
    const Vec3<F> out{around * cosine, around * sine, z};
    const auto round = is(PatchKind::kSphere);
    const Vec3<F> n = select(round, out * b.x, vector(12));
    Vec3<F> flat = fma(a, along_a, fma(b, along_b, o));
    const F off = number(11) - dot(n, flat);
    flat = fma(n, off, flat);
    const F own = number(15), before = select(own > zero, own, local_offset(n, flat, off));
    const Vec3<F> p = select(round, fma(out, a.x, o), flat);
    if (m.kind == MeterKind::kDistant) return {{fma(ahead, F(-4.f), p), ahead}, number(7)};
    Vec3<F> p1, p2;
    orthonormal_frame(n, p1, p2);
    const Vec3<F> local = cosine_hemisphere(u, v);
    const Vec3<F> d = fma(p1, local.x, fma(p2, local.y, n * local.z));
    return {{fma(n, before, p), d * (one / sqrt(dot(d, d)))}, number(7) * F(kPi)};
}

}  // namespace veriray
