// Directions along surfaces, and normals that textures turn, as in Mitsuba 3: s lies along the
// growth of u, across the interpolated normal n, and t = n x s.
#pragma once

#include "integrators/texturing.h"

namespace veriray {

template <class L>
struct Tangents {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    // Directions in which u and v alone grow, and their growth per length times |u| and |v|.
    struct Partials {
        V u, v;
        F per_u, per_v;
    };
    template <class Reader>
    static VR_HD Partials partials(const SceneView& scene, U prim, const Surface<L>& at, M lanes) {
        prim = select(lanes, prim, U(0u));
        const U row = prim * U(kTangentFloats);
        F of_u[4], of_v[4];
        gather4(scene.tangents, row, of_u), gather4(scene.tangents + 4, row, of_v);
        const V a{of_u[0], of_u[1], of_u[2]}, b{of_v[0], of_v[1], of_v[2]};
        Partials d{a, b, of_u[3], of_v[3]};
        if constexpr (Reader::has(kDisks)) {
            const M round = !(prim < U(scene.first_sphere - scene.disk_count));
            if (any(round)) {
                const U maps = prim * U(kUvFloats);
                const auto map = [&](uint32_t c) { return gather(scene.uv + c, maps); };
                const F x = dot(V{map(0), map(1), map(2)}, at.p) + map(3);
                const F y = dot(V{map(4), map(5), map(6)}, at.p) + map(7);
                F cosine, sine, radius;
                turn(x, y, cosine, sine, radius);
                const V along_a = a * (F(1.f) / d.per_u), along_b = b * (F(1.f) / d.per_v);
                const V u = fma(along_a, cosine, along_b * sine);
                const V v = fma(along_b, cosine, -along_a * sine);
                const F u_length = sqrt(dot(u, u)), v_length = sqrt(dot(v, v));
                d.u = select(round, u * (F(1.f) / u_length), d.u);
                d.v = select(round, v * (F(1.f) / v_length), d.v);
                d.per_u = select(round, F(1.f) / u_length, d.per_u);
                d.per_v = select(round, F(0.5f * kInvPi) / (v_length * radius), d.per_v);
            }
        }
        if constexpr (Reader::has(kSpheres)) {
            const M round = !(prim < U(scene.first_sphere));
            if (any(round)) {
                const V y_axis = cross(b, a) * of_v[3];
                const V outward = at.ng * Reader::primitive_column(scene, prim, kPrimSide);
                F cosine, sine, radius;
                turn(dot(a, outward), dot(y_axis, outward), cosine, sine, radius);
                const V away = fma(a, cosine, y_axis * sine);
                d.u = select(round, fma(y_axis, cosine, -a * sine), d.u);
                d.v = select(round, fma(away, dot(b, outward), -b * radius), d.v);
                const F per_radius = of_u[3] * F(kInvPi);
                d.per_u = select(round, F(0.5f) * per_radius / radius, d.per_u);
                d.per_v = select(round, per_radius, d.per_v);
            }
        }
        return d;
    }

    // A direction across a unit normal, along u; any direction where there is none.
    static VR_HD V across(V u, V n) {
        V any_one, other;
        orthonormal_frame(n, any_one, other);
        const V s = fma(n, -dot(n, u), u);
        const F s2 = dot(s, s);
        return select(s2 > F(0.f), s * (F(1.f) / sqrt(s2)), any_one);
    }

    // A surface as seen along wo: turns its normal n, on wo's side, and tells its material.
    template <class Reader, class Material>
    static VR_HD void relieve(const SceneView& scene, const Partials& d, const Surface<L>& at, V wo,
                              M lanes, Material& bsdf, V& n) {
        const auto column = [&](uint32_t c) { return Reader::surface_column(scene, at.row, c); };
        const M textured = lanes & (column(kSurfaceRelief) >= F(0.f));
        if (none(textured)) return;
        bsdf.relief.n = n;
        turn_normal(scene, column, d, at, wo, textured, n, bsdf.relief);
    }

   private:
    // column(c): of the surface.
    template <class Column, class Relief>
    static VR_HD void turn_normal(const SceneView& scene, Column column, const Partials& d,
                                  const Surface<L>& at, V wo, M textured, V& n, Relief& relief) {
        const V ns = at.ns, s = across(d.u, ns), t = cross(ns, s);
        const U traits = to_uint(column(kSurfaceReliefTraits));
        const auto has = [&](uint32_t trait) { return (traits & U(trait)) == U(trait); };
        const U row = to_uint(max(column(kSurfaceRelief), F(0.f)));
        V m{F(0.f), F(0.f), F(1.f)};
        const M heights = textured & has(kReliefHeights);
        if (any(textured & !heights)) {
            const S colour = Textures<L>::colour(scene.textures, row, at.uv, textured & !heights);
            const auto of = [&](uint32_t k) { return fma(colour[k], F(2.f), F(-1.f)); };
            m = select(heights, m, V{of(0), of(1), of(2)});
        }
        if (any(heights)) {
            S slope_u, slope_v;
            Textures<L>::slopes(scene.textures, row, at.uv, heights, slope_u, slope_v);
            const F scale = column(kSurface_relief_scale);
            const F rise_u = Texturing<L>::luminance(slope_u) * scale * d.per_u,
                    rise_v = Texturing<L>::luminance(slope_v) * scale * d.per_v;
            const auto tilted = [&](V along, F rise) {
                return fma(ns, rise - dot(ns, along), along);
            };
            const V c = cross(tilted(d.u, rise_u), tilted(d.v, rise_v));
            const F front = select(dot(at.ng, c) < F(0.f), F(-1.f), F(1.f));
            const M even = (rise_u == F(0.f)) & (rise_v == F(0.f));
            m = select(heights & !even, V{dot(s, c), dot(t, c), dot(ns, c)} * front, m);
        }
        const F x = dot(s, wo), y = dot(t, wo), z = dot(ns, wo);
        const M behind = !at.front, mirrored = behind & has(kReliefMirrored);
        const F up = select(mirrored, -z, z);
        const M away = has(kReliefFlips) & !(fma(up, m.z, fma(y, m.y, x * m.x)) * up > F(0.f));
        m.x = select(away, -m.x, m.x), m.y = select(away, -m.y, m.y);
        const F m2 = dot(m, m);
        const M sound = textured & (m2 > F(0.f)) & (m2 < F(kInfinity));
        const F scale = F(1.f) / sqrt(m2);
        m = select(sound, m * scale, V{F(0.f), F(0.f), F(1.f)});
        const F aside = fma(m.y, m.y, m.x * m.x);
        relief.lanes = (aside > F(0.f)) | (m.z < F(0.f));
        relief.some = any(relief.lanes);
        const F side = select(behind & !mirrored, F(-1.f), F(1.f));
        n = select(relief.lanes, renormalised(fma(s, m.x * side, fma(t, m.y * side, n * m.z))), n);
        const F slope = F(0.125f) * aside / (m.z * m.z);
        relief.low = select(relief.lanes & has(kReliefShades), min(slope, F(1.f)), F(0.f));
    }

    // The direction of (x, y) from the origin; +x there.
    static VR_HD void turn(F x, F y, F& cosine, F& sine, F& radius) {
        radius = sqrt(fma(x, x, y * y));
        const M away = radius > F(0.f);
        cosine = select(away, x / radius, F(1.f)), sine = select(away, y / radius, F(0.f));
    }
};

}  // namespace veriray
