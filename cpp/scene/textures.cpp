// Tables of textures and texels, and where primitives read them.
#include <algorithm>

#include "scene/scene.h"
#include "scene/thread_pool.h"
#include "textures/srgb.h"

namespace veriray {
namespace {

// The largest difference, as a share of the largest coordinate, of two triangles' coordinates at a
// point for which they count as one map: edges of 2^-8 of the scene, of corners rounded by 2^-25.
constexpr double kSameMap = 0x1p-16;

bool textured(const SceneInput& in, uint32_t material, int32_t emission) {
    bool any = emission >= 0 && in.emission_texture.data[emission] >= 0;
#define VR_TEXTURABLE(name) any |= in.name##_texture.data[material] >= 0;
#include "schema/materials.def"
    return any;
}

// An affine function of the point: g.p + w.
struct Affine {
    Double3 g;
    double w;

    double operator()(Double3 p) const { return dot(g, p) + w; }
};

// Of a triangle, from its values at the corners.
Affine through(const Flat& f, const double (&value)[3]) {
    const Double3 e1 = f.v[1] - f.v[0], e2 = f.v[2] - f.v[0], m = cross(e1, e2);
    const double m2 = dot(m, m);
    if (!(m2 > 0)) return {{0, 0, 0}, value[0]};
    const Double3 g =
        (cross(e2, m) * (value[1] - value[0]) + cross(m, e1) * (value[2] - value[0])) * (1 / m2);
    return {g, value[0] - dot(g, f.v[0])};
}

uint32_t traits_of(const SceneInput& in, size_t t) {
    if (in.texture_kind.data[t] == kCheckerboard) return kTraitBoard;
    const uint32_t wrap = in.texture_wrap.data[t], format = in.texture_format.data[t];
    return (wrap == kRepeat   ? kTraitRepeat
            : wrap == kMirror ? kTraitMirror
                              : 0u) |
           (in.texture_filter.data[t] == kNearest ? kTraitNearest : 0u) |
           (in.texture_grey.data[t] ? kTraitGrey : 0u) |
           (format == kSrgb8   ? kTraitSrgb
            : format == kHalf  ? kTraitHalf
            : format == kFloat ? kTraitFloat
                               : 0u);
}

}  // namespace

// Texture coordinates at the corners of a triangle: x is u, y is v.
std::array<Double3, 3> HostScene::corner_uv(const SceneInput& in, const Flat& f) const {
    std::array<Double3, 3> out;
    for (size_t k = 0; k < 3; ++k) {
        const float* uv = in.uv.data + 2 * size_t{in.triangles.data[3 * size_t{f.triangle} + k]};
        out[k] = {static_cast<double>(uv[0]), static_cast<double>(uv[1]), 0};
    }
    if (f.swapped) std::swap(out[1], out[2]);
    return out;
}

// Whether two triangles of one material in one plane map points to a texture alike.
bool HostScene::same_texture_map(const SceneInput& in, const Flat& a, const Flat& b) const {
    if (!textured(in, a.material, a.emission)) return true;
    const auto from = corner_uv(in, a), to = corner_uv(in, b);
    for (int c = 0; c < 2; ++c) {
        double most = 0;
        for (size_t k = 0; k < 3; ++k)
            most = std::max({most, std::abs(from[k][c]), std::abs(to[k][c])});
        const Affine map = through(a, {from[0][c], from[1][c], from[2][c]});
        for (size_t k = 0; k < 3; ++k)
            if (!(std::abs(map(b.v[k]) - to[k][c]) <= kSameMap * most)) return false;
    }
    return true;
}

void HostScene::put_uv(const SceneInput& in, size_t primitive) {
    float* out = &uv[primitive * kUvFloats];
    const PrimitiveSource& s = sources[primitive];
    if (s.group == kSphereGroup) {
        const float* frame = in.sphere_frame.data + 9 * size_t{s.row};
        const auto axis = [&](int k) {
            return Double3{static_cast<double>(frame[3 * k]), static_cast<double>(frame[3 * k + 1]),
                           static_cast<double>(frame[3 * k + 2])};
        };
        std::copy_n(frame, 3, out);
        std::copy_n(frame + 6, 3, out + 4);
        out[3] = dot(cross(axis(2), axis(0)), axis(1)) < 0 ? -1.f : 1.f;
        return;
    }
    Affine maps[2];
    if (s.group == kDiskGroup) {
        const Double3 c = (row3(in.disks, 3 * size_t{s.row}) - centre) * (1 / unit);
        Double3 a = row3(in.disks, 3 * size_t{s.row} + 1) * (1 / unit),
                b = row3(in.disks, 3 * size_t{s.row} + 2) * (1 / unit);
        if (in.disk_turned.data[s.row]) std::swap(a, b);
        const Double3 n = cross(a, b);
        const double n2 = dot(n, n);
        const Double3 g[2] = {cross(b, n) * (1 / n2), cross(n, a) * (1 / n2)};
        for (int k = 0; k < 2; ++k) maps[k] = {g[k], -dot(g[k], c)};
    } else {
        const Flat f = triangle(in, s.row);
        const auto at = corner_uv(in, f);
        for (int k = 0; k < 2; ++k) maps[k] = through(f, {at[0][k], at[1][k], at[2][k]});
    }
    for (int k = 0; k < 2; ++k) {
        for (int c = 0; c < 3; ++c) out[4 * k + c] = static_cast<float>(maps[k].g[c]);
        out[4 * k + 3] = static_cast<float>(maps[k].w);
    }
}

void HostScene::set_textures(const SceneInput& in) {
    for (size_t q = 0; q < in.light_texture.count; ++q)
        if (in.light_texture.data[q] >= 0) view.features |= kLightTextures;
    if (!(view.features & (kTextures | kLightTextures))) return;
    const size_t count = in.textures_rows();
    const uint32_t stride = padded(count);
    textures.assign(size_t{kTextureColumns} * stride, 0.f);
    for (size_t t = 0; t < count; ++t) {
        const auto put = [&](uint32_t c, float x) { textures[size_t{c} * stride + t] = x; };
        const bool bitmap = in.texture_kind.data[t] == kBitmap;
        for (uint32_t k = 0; k < 6; ++k) put(kTextureToUv + k, in.texture_to_uv.data[6 * t + k]);
        for (uint32_t k = 0; k < 3; ++k) {
            put(kTextureColor0 + k, in.texture_color0.data[3 * t + k]);
            put(kTextureColor1 + k, in.texture_color1.data[3 * t + k]);
        }
        put(kTextureWidth, bitmap ? static_cast<float>(in.texture_width.data[t]) : 1.f);
        put(kTextureHeight, bitmap ? static_cast<float>(in.texture_height.data[t]) : 1.f);
        put(kTextureFirst, bit_cast<float>(bitmap ? in.texture_first.data[t] : 0u));
        put(kTextureTraits, bit_cast<float>(traits_of(in, t)));
    }
    texels.resize(kCodeWords + in.texels.count);
    for (uint32_t code = 0; code < 256; ++code) {
        texels[code] = bit_cast<uint32_t>(kLinearOfSrgb[code]);
        texels[256 + code] = bit_cast<uint32_t>(static_cast<float>(code) / 255.f);
    }
    std::copy_n(in.texels.data, in.texels.count, texels.begin() + kCodeWords);
    view.textures = {textures.data(), stride, static_cast<uint32_t>(count), texels.data()};
    if (!(view.features & kTextures)) return;  // on no surface
    uv.assign(sources.size() * kUvFloats, 0.f);
    in_chunks(kAllThreads, sources.size(), [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i) put_uv(in, i);
    });
    view.uv = uv.data();
}

}  // namespace veriray
