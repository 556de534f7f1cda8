// Where surfaces read textures, and the numbers of a material that these give.
#pragma once

#include "integrators/called.h"
#include "integrators/path_state.h"

namespace veriray {

// kWithAttributes: some textures are attributes of meshes, or stand in others.
template <class L, bool kWithAttributes = false>
struct Texturing {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;
    using Point = TexturePoint<L>;

    // The place on a primitive of a point, or of the outward normal of a sphere.
    template <FeatureMask kFeatures, class Outward>
    static VR_HD Point place(const SceneView& scene, U prim, V p, Outward outward_normal) {
        Point uv;
        uv.u = uv.v = F(0.f);
        if (!scene.uv) return uv;
        const U row = prim * U(kUvFloats);
        F of_u[4], of_v[4];
        gather4(scene.uv, row, of_u), gather4(scene.uv + 4, row, of_v);
        const V a{of_u[0], of_u[1], of_u[2]}, b{of_v[0], of_v[1], of_v[2]};
        const F last = of_u[3];
        uv.u = dot(a, p) + last, uv.v = dot(b, p) + of_v[3];
        if constexpr (kWithAttributes) uv.p = p, uv.primitive = prim;
        if constexpr ((kFeatures & kDisks) != 0) {
            const M round = !(prim < U(scene.first_sphere - scene.disk_count));
            if (any(round)) {
                const F radius = sqrt(fma(uv.u, uv.u, uv.v * uv.v));
                uv.v = select(round, share_of_turn(uv.u, uv.v), uv.v);
                uv.u = select(round, radius, uv.u);
            }
        }
        if constexpr ((kFeatures & kSpheres) != 0) {
            const M round = !(prim < U(scene.first_sphere));
            if (any(round)) {
                const V outward = outward_normal();
                const F x = dot(a, outward), y = dot(cross(b, a), outward) * last;
                const F across = sqrt(fma(x, x, y * y));
                uv.u = select(round, share_of_turn(x, y), uv.u);
                uv.v = select(round, angle(dot(b, outward), across) * F(kInvPi), uv.v);
            }
        }
        return uv;
    }

    // Multiplies lanes of a colour by the texture of that index; -1: none.
    static VR_HD void multiply(const SceneView& scene, F index, Point uv, M lanes, S& value) {
        lanes = lanes & (index >= F(0.f));
        if (none(lanes)) return;
        const U row = to_uint(max(index, F(0.f)));
        const S colour = Textures<L, kWithAttributes>::colour(scene.textures, row, uv, lanes);
        value = select(lanes, value * colour, value);
    }

    // Replaces the numbers of a material for which its surface has a texture; column(c): of the
    // surface.
    template <class Column, class Material>
    static VR_HD void replace(const SceneView& scene, Column column, Point uv, Material& m) {
        if (!scene.uv) return;
        [[maybe_unused]] const S coat = m.parameters.reflectance;
        constexpr uint32_t kRead = read_bits<Material>();
        const U given = as_uint(column(kSurfaceTextured)) & U(kRead);
        VR_ROLLED  // one copy of the lookup's code
            for (uint32_t k = 0; kRead >> k; ++k) {
            const M textured = (given & U(1u << k)) == U(1u << k);
            if (none(textured)) continue;
            const F row = column(kSurfaceFirstTexture + k);
            const S colour = looked_up(scene, row, uv, textured);
            switch (k) {
#define VR_TEXTURABLE(name)                                                     \
    case kTexturable_##name:                                                    \
        if constexpr (Material::reads(kParameter_##name))                       \
            put(m.parameters.name, textured, colour, least(kParameter_##name)); \
        break;
#include "schema/materials.def"
                default:
                    break;
            }
        }
        if constexpr (Material::has(kCoatedKinds)) {
            const M lanes = m.template any_of<kCoatedKinds>() &
                            (column(kSurface_reflectance_texture) >= F(0.f));
            S& rho = m.parameters.reflectance;
            if (any(lanes)) rho = select(lanes, base_in_coat(rho, coat), rho);
        }
    }
    // The number of a column, for which the surface may have a texture.
    template <class Column>
    static VR_HD F number(const SceneView& scene, Column column, SurfaceColumn c,
                          SurfaceColumn texture, Point uv) {
        F value = column(c);
        if (!scene.uv) return value;
        const F row = column(texture);
        const M textured = row >= F(0.f);
        if (any(textured)) put(value, textured, looked_up(scene, row, uv, textured), F(0.f));
        return value;
    }

    // The number of a grey colour is itself.
    static VR_HD F luminance(const S& s) {
        const F sum = fma(s[2], F(0.072169f), fma(s[1], F(0.71516f), s[0] * F(0.212671f)));
        return select((s[0] == s[1]) & (s[1] == s[2]), s[0], sum);
    }

   private:
    // The angle of (x, y) in turns, in [0, 1].
    static VR_HD F share_of_turn(F x, F y) {
        const F turns = angle(x, y) * F(0.5f * kInvPi);
        return select(turns < F(0.f), turns + F(1.f), turns);
    }
    // The least value that a texture gives, as of Mitsuba's: slopes are not 0.
    static VR_HD F least(ParameterBit p) {
        return F(p == kParameter_alpha_u || p == kParameter_alpha_v ? 1e-4f : 0.f);
    }
    // The bits of the parameters that the materials read.
    template <class Material>
    static constexpr uint32_t read_bits() {
        uint32_t bits = 0;
#define VR_TEXTURABLE(name) \
    if (Material::reads(kParameter_##name)) bits |= 1u << kTexturable_##name;
#include "schema/materials.def"
        return bits;
    }
    static VR_HD S looked_up(const SceneView& scene, F row, Point uv, M textured) {
        return Textures<L, kWithAttributes>::colour(scene.textures, to_uint(max(row, F(0.f))), uv,
                                                    textured);
    }
    template <class Value>
    static VR_HD void put(Value& value, M textured, const S& colour, F least) {
        if constexpr (std::is_same_v<Value, S>)
            value = select(textured, colour, value);
        else
            value = select(textured, max(luminance(colour), least), value);
    }
    // The reflectance of a base within a coat; coat: what surfaces.cpp left in its place.
    static VR_HD S base_in_coat(const S& rho, const S& coat) {
        return S::of([&](uint32_t k) {
            const F again = select(coat[1] > F(0.f), rho[k], F(1.f)) * coat[0];
            return rho[k] * coat[2] / (F(1.f) - again);
        });
    }
};

}  // namespace veriray
