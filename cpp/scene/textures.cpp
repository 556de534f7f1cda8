// Tables of textures and texels, and where primitives read them.
#include <algorithm>
#include <map>

#include "scene/scene.h"
#include "scene/thread_pool.h"
#include "textures/srgb.h"

namespace veriray {
namespace {

// What rounding to float32 moves: a texture coordinate by this share of itself, a corner of a
// triangle by half of it per coordinate.
constexpr double kRounded = 0x1p-24;

// Whether fits(texture) holds of a texture of a face: of its material, the other one of its blend,
// or its emission.
template <class Fits>
bool some_texture(const SceneInput& in, uint32_t material, int32_t emission, Fits fits) {
    if (emission >= 0 && in.emission_texture.data[emission] >= 0 &&
        fits(in.emission_texture.data[emission]))
        return true;
    return in.either(material, [&](uint32_t m) {
        bool any = false;
        const auto look = [&](int32_t texture) { any |= texture >= 0 && fits(texture); };
#define VR_TEXTURABLE(name) look(in.name##_texture.data[m]);
#include "schema/materials.def"
        return any;
    });
}

// The textures in the fields of a checkerboard, -1 for none, as those of all others.
std::array<int32_t, 2> fields_of(const SceneInput& in, size_t texture) {
    if (in.texture_kind.data[texture] != kCheckerboard) return {-1, -1};
    return {in.texture_field0.data[texture], in.texture_field1.data[texture]};
}

bool is_nested(const SceneInput& in, size_t texture) {
    const auto fields = fields_of(in, texture);
    return fields[0] >= 0 || fields[1] >= 0;
}

bool is_attribute(const SceneInput& in, size_t texture) {
    const uint32_t kind = in.texture_kind.data[texture];
    return kind == kVertexAttribute || kind == kFaceAttribute;
}

// Or where an attribute stands in it.
bool reads_attribute(const SceneInput& in, size_t texture) {
    if (is_attribute(in, texture)) return true;
    for (const int32_t field : fields_of(in, texture))
        if (field >= 0 && reads_attribute(in, static_cast<size_t>(field))) return true;
    return false;
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
    if (in.texture_kind.data[t] == kCheckerboard)
        return kTraitBoard | (is_nested(in, t) ? kTraitNested : 0u);
    if (in.texture_kind.data[t] == kVertexAttribute) return kTraitVertex;
    if (in.texture_kind.data[t] == kFaceAttribute) return kTraitFace;
    const uint32_t format = in.texture_format.data[t];
    return (in.texture_kind.data[t] == kVolume ? kTraitVolume : 0u) |
           lookup_traits(in.texture_wrap.data[t], in.texture_filter.data[t],
                         in.texture_grey.data[t] != 0) |
           (format == kSrgb8   ? kTraitSrgb
            : format == kHalf  ? kTraitHalf
            : format == kFloat ? kTraitFloat
                               : 0u);
}

// Two unit vectors across a unit normal, as core/mapping.h has them.
void axes_across(Double3 n, Double3 (&axes)[2]) {
    const double sign = n.z < 0 ? -1 : 1, p = -1 / (sign + n.z), q = n.x * n.y * p;
    axes[0] = {sign * n.x * n.x * p + 1, sign * q, -sign * n.x};
    axes[1] = {q, n.y * n.y * p + sign, -n.y};
}

}  // namespace

// Of textures and of grids.
uint32_t lookup_traits(uint32_t wrap, uint32_t filter, bool grey) {
    return (wrap == kRepeat   ? kTraitRepeat
            : wrap == kMirror ? kTraitMirror
                              : 0u) |
           (filter == kNearest ? kTraitNearest : 0u) | (grey ? kTraitGrey : 0u);
}

// Whether the directions in which u and v grow matter on a material's surfaces.
bool has_tangents(const SceneInput& in, uint32_t material) {
    return closure_traits(in.material_kind.data[material]).follows ||
           in.relief_texture.data[material] >= 0 ||
           in.alpha_u.data[material] != in.alpha_v.data[material] ||
           in.alpha_u_texture.data[material] != in.alpha_v_texture.data[material] ||
           in.anisotropic.data[material] != 0 || in.anisotropic_texture.data[material] >= 0;
}

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
    if (!has_tangents(in, a.material) &&
        !some_texture(in, a.material, a.emission, [](int32_t) { return true; }))
        return true;
    if (some_texture(in, a.material, a.emission,
                     [&](int32_t t) { return reads_attribute(in, static_cast<size_t>(t)); }))
        return false;
    const auto from = corner_uv(in, a), to = corner_uv(in, b);
    // At b's corners but for rounding, where a's corners count by their shares in the point.
    const Affine share[3] = {through(a, {1, 0, 0}), through(a, {0, 1, 0}), through(a, {0, 0, 1})};
    for (int c = 0; c < 2; ++c) {
        const Affine map = through(a, {from[0][c], from[1][c], from[2][c]});
        const double steep = std::abs(map.g.x) + std::abs(map.g.y) + std::abs(map.g.z);
        for (size_t k = 0; k < 3; ++k) {
            double turned = std::abs(to[k][c]), moved = 1;
            for (size_t j = 0; j < 3; ++j) {
                const double weight = std::abs(share[j](b.v[k]));
                turned += weight * std::abs(from[j][c]), moved += weight;
            }
            const double slack = kRounded * (turned + 0.5 * steep * moved);
            if (!(std::abs(map(b.v[k]) - to[k][c]) <= slack)) return false;
        }
    }
    return true;
}

void HostScene::put_uv(const SceneInput& in, size_t primitive, float* out) const {
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

// A primitive's part of an attribute.
void HostScene::put_attribute(const SceneInput& in, size_t t, size_t primitive,
                              uint32_t* out) const {
    const PrimitiveSource& s = sources[primitive];
    if (s.group != kTriangleGroup) return;
    const float* rows = in.attribute_values.data + 3 * size_t{in.texture_first.data[t]};
    const auto put = [&](size_t c, double x) {
        out[c] = bit_cast<uint32_t>(static_cast<float>(x));
    };
    if (in.texture_kind.data[t] == kFaceAttribute) {
        for (size_t k = 0; k < 3; ++k) put(k, static_cast<double>(rows[3 * size_t{s.row} + k]));
        return;
    }
    const Flat f = triangle(in, s.row);
    for (size_t k = 0; k < 3; ++k) {
        double value[3];
        for (size_t c = 0; c < 3; ++c)
            value[c] =
                static_cast<double>(rows[3 * size_t{in.triangles.data[3 * size_t{s.row} + c]} + k]);
        if (f.swapped) std::swap(value[1], value[2]);
        const Affine map = through(f, value);
        for (int c = 0; c < 3; ++c) put(kVertexWords * k + static_cast<size_t>(c), map.g[c]);
        put(kVertexWords * k + 3, map.w);
        put(kVertexWords * k + 4, std::min({value[0], value[1], value[2]}));
        put(kVertexWords * k + 5, std::max({value[0], value[1], value[2]}));
    }
}

// Attributes stand behind the texels.
void HostScene::set_attributes(const SceneInput& in) {
    std::map<std::pair<bool, uint32_t>, size_t> known;  // where it is, by its kind and first row
    for (size_t t = 0; t < in.textures_rows(); ++t) {
        if (!is_attribute(in, t)) continue;
        view.features |= kAttributes;
        const bool face = in.texture_kind.data[t] == kFaceAttribute;
        const size_t step = face ? kFaceWords : kAttributeWords;
        const auto [at, fresh] = known.try_emplace({face, in.texture_first.data[t]}, texels.size());
        const size_t first = at->second;
        if (first + step * sources.size() >= kMostNumbers)
            throw std::invalid_argument("attributes of " + std::to_string(sources.size()) +
                                        " primitives take too much memory");
        textures[size_t{kTextureFirst} * padded(in.textures_rows()) + t] =
            bit_cast<float>(static_cast<uint32_t>(first - kCodeWords));
        if (!fresh) continue;
        texels.resize(first + step * sources.size());
        in_chunks(kAllThreads, sources.size(), [&](size_t begin, size_t end) {
            for (size_t i = begin; i < end; ++i) put_attribute(in, t, i, &texels[first + step * i]);
        });
    }
    if (view.features & kAttributes) texels.resize(texels.size() + kAttributeWords);
}

void HostScene::put_tangents(const SceneInput& in, size_t primitive) {
    float* out = &tangents[primitive * kTangentFloats];
    const PrimitiveSource& s = sources[primitive];
    if (s.group == kSphereGroup) {
        std::copy_n(&uv[primitive * kUvFloats], kUvFloats, out);
        out[7] = out[3];
        out[3] = static_cast<float>(unit / in.spheres.data[4 * size_t{s.row} + 3]);
        return;
    }
    Double3 along[2];
    bool both = true;  // u and v change, in directions of their own
    if (s.group == kDiskGroup) {
        for (size_t k = 0; k < 2; ++k)
            along[in.disk_turned.data[s.row] ? 1 - k : k] =
                row3(in.disks, 3 * size_t{s.row} + 1 + k) * (1 / unit);
    } else {
        const Flat f = triangle(in, s.row);
        const auto at = corner_uv(in, f);
        const Double3 e1 = f.v[1] - f.v[0], e2 = f.v[2] - f.v[0], u = at[1] - at[0],
                      v = at[2] - at[0];
        const double turn = u.x * v.y - u.y * v.x;
        along[0] = e1 * (v.y / turn) - e2 * (u.y / turn);
        along[1] = e2 * (u.x / turn) - e1 * (v.x / turn);
        both = turn != 0 && length(along[0]) < INFINITY && length(along[1]) < INFINITY;
        if (!both) {
            // Where v stays, as at the ends of a linear curve, fibres lie across the rise of u.
            const Double3 n = cross(e1, e2), rise = cross(e2, n) * u.x + cross(n, e1) * v.x;
            if (closure_traits(in.material_kind.data[s.material]).follows && length(rise) > 0) {
                along[0] = normalised(rise), along[1] = normalised(cross(n, rise));
            } else {
                axes_across(normalised(n), along);
            }
        }
    }
    for (size_t k = 0; k < 2; ++k) {
        const double per = both ? 1 / length(along[k]) : 1;
        const Double3 d = along[k] * per;
        const double row[4] = {d.x, d.y, d.z, per};
        for (size_t c = 0; c < 4; ++c) out[4 * k + c] = static_cast<float>(row[c]);
    }
}

std::vector<float> HostScene::texture_maps(const SceneInput& in) const {
    if (view.uv) return {uv.begin(), uv.end()};
    std::vector<float> out(sources.size() * kUvFloats);
    in_chunks(kAllThreads, sources.size(), [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i) put_uv(in, i, &out[i * kUvFloats]);
    });
    return out;
}

void HostScene::set_textures(const SceneInput& in) {
    for (size_t q = 0; q < in.light_texture.count; ++q)
        if (in.light_texture.data[q] >= 0) view.features |= kLightTextures;
    if (!(view.features & (kTextures | kTangents | kLightTextures))) return;
    const size_t count = in.textures_rows();
    const uint32_t stride = padded(count);
    textures.assign(size_t{kTextureColumns} * stride, 0.f);
    for (size_t t = 0; t < count; ++t) {
        const auto put = [&](uint32_t c, float x) { textures[size_t{c} * stride + t] = x; };
        const bool solid = in.texture_kind.data[t] == kVolume,
                   bitmap = solid || in.texture_kind.data[t] == kBitmap;
        for (uint32_t k = 0; k < 6; ++k) put(kTextureToUv + k, in.texture_to_uv.data[6 * t + k]);
        for (uint32_t k = 0; k < 3; ++k) {
            put(kTextureColor0 + k, in.texture_color0.data[3 * t + k]);
            put(kTextureColor1 + k, in.texture_color1.data[3 * t + k]);
        }
        put(kTextureWidth, bitmap ? static_cast<float>(in.texture_width.data[t]) : 1.f);
        put(kTextureHeight, bitmap ? static_cast<float>(in.texture_height.data[t]) : 1.f);
        put(kTextureFirst, bit_cast<float>(bitmap ? in.texture_first.data[t] : 0u));
        put(kTextureTraits, bit_cast<float>(traits_of(in, t)));
        const auto fields = fields_of(in, t);
        for (uint32_t k = 0; k < 2; ++k)
            put(kTextureField0 + k, bit_cast<float>(static_cast<uint32_t>(fields[k])));
        if (is_nested(in, t) || solid) view.features |= kAttributes;
        if (solid) {
            const auto rows = to_cube(in.texture_to_world.data + 12 * t);
            for (uint32_t k = 0; k < 12; ++k) put(kTextureToCube + k, static_cast<float>(rows[k]));
            put(kTextureDepth, bit_cast<float>(in.texture_depth.data[t]));
        }
    }
    texels.resize(kCodeWords + in.texels.count);
    for (uint32_t code = 0; code < 256; ++code) {
        texels[code] = bit_cast<uint32_t>(kLinearOfSrgb[code]);
        texels[256 + code] = bit_cast<uint32_t>(static_cast<float>(code) / 255.f);
    }
    std::copy_n(in.texels.data, in.texels.count, texels.begin() + kCodeWords);
    set_attributes(in);
    view.textures = {textures.data(), stride, static_cast<uint32_t>(count), texels.data()};
    if (!(view.features & (kTextures | kTangents))) return;  // on no surface
    uv.assign(sources.size() * kUvFloats, 0.f);
    in_chunks(kAllThreads, sources.size(), [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i) put_uv(in, i, &uv[i * kUvFloats]);
    });
    view.uv = uv.data();
    if (view.features & kTangents) {
        tangents.assign(sources.size() * kTangentFloats, 0.f);
        in_chunks(kAllThreads, sources.size(), [&](size_t first, size_t last) {
            for (size_t i = first; i < last; ++i) put_tangents(in, i);
        });
        view.tangents = tangents.data();
    }
}

}  // namespace veriray
