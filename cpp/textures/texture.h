// Textures by lane: rows of the texture table, and what they are at a point (u, v).
//
// A bitmap's first row of texels is at v = 0, and the centre of texel k of n is at (k + 1/2) / n.
// Between centres colours are interpolated, first along u, in float32.
//
// An attribute is of the vertices or faces of meshes: by primitive, three numbers of a face, or for
// each of three an affine function of the point, its least and its largest value at the corners.
// Between these it stays where the point is rounded out of its triangle.
//
// A volume has texels along three axes of a cube, and is read at the point in space.
//
// A field of a checkerboard may be a texture, of a row before it, which is read at the same place.
#pragma once

#include "spectrum/spectrum.h"

namespace veriray {

// The values of the columns texture_kind, texture_wrap, texture_filter and texture_format.
enum TextureKind : uint32_t { kBitmap, kCheckerboard, kVertexAttribute, kFaceAttribute, kVolume };
enum TextureWrap : uint32_t { kRepeat, kMirror, kClamp };
enum TextureFilter : uint32_t { kBilinear, kNearest };
enum TexelFormat : uint32_t { kSrgb8, kLinear8, kHalf, kFloat };

// Bytes of a texel; colours of 8 bits and half ones have a fourth number, so that they do not
// straddle.
constexpr uint32_t texel_bytes(uint32_t format, bool grey) {
    const uint32_t one = format == kFloat ? 4 : format == kHalf ? 2 : 1;
    return grey ? one : format == kFloat ? 12 : 4 * one;
}

enum TextureColumn : uint32_t {
    kTextureToUv,                         // 2 rows of what takes (u, v, 1) to its coordinates
    kTextureColor0 = kTextureToUv + 6,    // of a checkerboard: 3 columns
    kTextureColor1 = kTextureColor0 + 3,  // 3 columns
    kTextureWidth = kTextureColor1 + 3,   // in texels; 1 without any
    kTextureHeight,
    kTextureFirst,   // its first word; bits
    kTextureTraits,  // TextureTrait; bits
    kTextureField0,  // of a checkerboard: the row of a texture, ~0 where its colour counts; bits
    kTextureField1,
    kTextureColumns,
    // Of a volume, in place of coordinates and colours: what takes (p, 1) to its cube, 3 rows of 4.
    kTextureToCube = kTextureToUv,
    kTextureDepth = kTextureField0,  // in texels; bits
};
static_assert(kTextureToCube + 12 == kTextureWidth);
enum TextureTrait : uint32_t {
    kTraitBoard = 1,
    kTraitRepeat = 2,
    kTraitMirror = 4,
    kTraitNearest = 8,
    kTraitGrey = 16,
    kTraitSrgb = 32,
    kTraitHalf = 64,
    kTraitFloat = 128,  // none of the three: 8 bits, linear
    kTraitVertex = 256,
    kTraitFace = 512,
    kTraitNested = 1024,  // a checkerboard with a texture in a field
    kTraitVolume = 2048,
};

// Words before the texels: the numbers of 8-bit codes, of sRGB and linear.
inline constexpr uint32_t kCodeWords = 512;
// Words of an attribute by primitive: g, w, least and largest of a vertex attribute's numbers.
inline constexpr uint32_t kVertexWords = 6, kAttributeWords = 3 * kVertexWords, kFaceWords = 3;

struct TextureView {
    const float* table;  // [column][stride]
    uint32_t stride, count;
    const uint32_t* texels;  // kCodeWords, then the texels, then attributes
};

// Coordinates on a surface; for attributes its point and primitive.
template <class L>
struct TexturePoint {
    typename L::F u, v;
    Vec3<typename L::F> p;
    typename L::U primitive;
};

// kWithAttributes: some are attributes or stand in others.
template <class L, bool kWithAttributes = false>
struct Textures {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using S = Spectrum<F>;
    using Point = TexturePoint<L>;

    // The colour of a texture where m is set; any valid row elsewhere.
    static VR_LONG S colour(const TextureView textures, U row, Point at, M m) {
        if constexpr (kWithAttributes) row = innermost(textures, row, at, m);
        const auto column = [&](uint32_t c) { return column_of(textures, row, c); };
        const F u = coordinate(textures, row, kTextureToUv, at);
        const F v = coordinate(textures, row, kTextureToUv + 3, at);
        const U traits = as_uint(column(kTextureTraits));
        const M board = is(traits, kTraitBoard);
        S value = S::all(F(0.f));
        if (any(m & board)) {
            const M first = in_first_field(u, v);
            value = S::of([&](uint32_t k) {
                return select(first, column(kTextureColor0 + k), column(kTextureColor1 + k));
            });
        }
        M bitmap = m & !board;
        if constexpr (kWithAttributes) {
            const M face = is(traits, kTraitFace),
                    attribute = bitmap & (face | is(traits, kTraitVertex));
            if (any(attribute)) {
                const U first = as_uint(column(kTextureFirst)) + U(kCodeWords);
                value =
                    select(attribute, on_mesh(textures.texels, first, at, face, attribute), value);
                bitmap = bitmap & !attribute;
            }
            const M solid = bitmap & is(traits, kTraitVolume);
            if (any(solid)) {
                value = select(solid, in_volume(textures, row, at.p, traits, solid), value);
                bitmap = bitmap & !solid;
            }
        }
        if (none(bitmap)) return value;
        const F width = column(kTextureWidth), height = column(kTextureHeight);
        const Texels texels{textures.texels, as_uint(column(kTextureFirst)) + U(kCodeWords), traits,
                            bitmap};
        const Taps x = taps(u, width, traits), y = taps(v, height, traits);
        const U row0 = y.first * to_uint(width), row1 = y.second * to_uint(width);
        S colour = texels.at(row0 + x.first);
        if (any(bitmap & !is(traits, kTraitNearest))) {
            const S low = mix(colour, texels.at(row0 + x.second), x.share);
            const S high = mix(texels.at(row1 + x.first), texels.at(row1 + x.second), x.share);
            colour = mix(low, high, y.share);
        }
        return select(bitmap, colour, value);
    }

    // How much a bitmap's colour grows with u and v; 0 if its texels are not interpolated.
    static VR_LONG void slopes(const TextureView textures, U row, Point at, M m, S& by_u, S& by_v) {
        const auto column = [&](uint32_t c) { return column_of(textures, row, c); };
        const U traits = as_uint(column(kTextureTraits));
        const F width = column(kTextureWidth), height = column(kTextureHeight);
        const Texels texels{textures.texels, as_uint(column(kTextureFirst)) + U(kCodeWords), traits,
                            m};
        const Taps x = taps(coordinate(textures, row, kTextureToUv, at), width, traits),
                   y = taps(coordinate(textures, row, kTextureToUv + 3, at), height, traits);
        const U row0 = y.first * to_uint(width), row1 = y.second * to_uint(width);
        const S a = texels.at(row0 + x.first), b = texels.at(row0 + x.second),
                c = texels.at(row1 + x.first), d = texels.at(row1 + x.second);
        const M smooth = !is(traits, kTraitNearest);
        const F across = select(smooth, x.way * width, F(0.f)),
                down = select(smooth, y.way * height, F(0.f));
        const auto rise = [](const S& from, const S& to) {
            return S::of([&](uint32_t k) { return to[k] - from[k]; });
        };
        const S along_x = mix(rise(a, b), rise(c, d), y.share) * across,
                along_y = mix(rise(a, c), rise(b, d), x.share) * down;
        const auto turned = [&](uint32_t k) {
            return fma(along_y, column(kTextureToUv + 3 + k), along_x * column(kTextureToUv + k));
        };
        by_u = turned(0), by_v = turned(1);
    }

   protected:
    // Whether a place on a checkerboard is in a field of its first colour.
    static VR_HD M in_first_field(F u, F v) {
        const M a = u - floor(u) > F(0.5f), b = v - floor(v) > F(0.5f);
        return (a & b) | !(a | b);
    }
    // The row of the texture in the field of a checkerboard, and in that one's, where m is set.
    static VR_HD U innermost(const TextureView& textures, U row, Point at, M m) {
        for (;;) {
            const U traits = as_uint(column_of(textures, row, kTextureTraits));
            m = m & is(traits, kTraitNested);
            if (none(m)) return row;
            const M first = in_first_field(coordinate(textures, row, kTextureToUv, at),
                                           coordinate(textures, row, kTextureToUv + 3, at));
            const U field = as_uint(select(first, column_of(textures, row, kTextureField0),
                                           column_of(textures, row, kTextureField1)));
            m = m & !(field == U(~0u));
            row = select(m, field, row);
        }
    }
    // An attribute; first: its first word. Behind the last one are kAttributeWords more.
    static VR_HD S on_mesh(const uint32_t* words, U first, Point at, M face, M lanes) {
        const U step = select(face, U(kFaceWords), U(kAttributeWords));
        const U row = select(lanes, first + at.primitive * step, U(0u));
        return S::of([&](uint32_t k) {
            const auto number = [&](uint32_t c) {
                return as_float(gather(words, row + U(kVertexWords * k + c)));
            };
            const F x =
                fma(number(2), at.p.z, fma(number(1), at.p.y, fma(number(0), at.p.x, number(3))));
            const F whole = as_float(gather(words, row + U(k)));
            return select(face, whole, min(max(x, number(4)), number(5)));
        });
    }
    static VR_HD S in_volume(const TextureView& textures, U row, const Vec3<F>& p, U traits,
                             M lanes) {
        const auto column = [&](uint32_t c) { return column_of(textures, row, c); };
        const auto coordinate = [&](uint32_t c) {
            return fma(column(c), p.x,
                       fma(column(c + 1), p.y, fma(column(c + 2), p.z, column(c + 3))));
        };
        const F width = column(kTextureWidth), height = column(kTextureHeight);
        const F depth = to_float(as_uint(column(kTextureDepth)));
        const Texels texels{textures.texels, as_uint(column(kTextureFirst)) + U(kCodeWords), traits,
                            lanes};
        const Taps x = taps(coordinate(kTextureToCube), width, traits),
                   y = taps(coordinate(kTextureToCube + 4), height, traits),
                   z = taps(coordinate(kTextureToCube + 8), depth, traits);
        const U across = to_uint(width), area = across * to_uint(height);
        const auto line = [&](U start) {
            return mix(texels.at(start + x.first), texels.at(start + x.second), x.share);
        };
        const auto layer = [&](U start) {
            return mix(line(start + y.first * across), line(start + y.second * across), y.share);
        };
        return mix(layer(z.first * area), layer(z.second * area), z.share);
    }
    static VR_HD F column_of(const TextureView& textures, U row, uint32_t c) {
        return lookup(textures.table + static_cast<uint64_t>(c) * textures.stride, row,
                      textures.count);
    }
    static VR_HD F coordinate(const TextureView& textures, U row, uint32_t c, Point at) {
        const auto column = [&](uint32_t k) { return column_of(textures, row, c + k); };
        return fma(column(0), at.u, fma(column(1), at.v, column(2)));
    }
    static VR_HD M is(U traits, uint32_t trait) { return (traits & U(trait)) == U(trait); }
    // Equal colours stay as they are.
    static VR_HD S mix(const S& a, const S& b, F share) {
        return S::of([&](uint32_t k) { return fma(share, b[k] - a[k], a[k]); });
    }

    // The texels on both sides of a coordinate along an axis of n, and the second one's share.
    struct Taps {
        U first, second;
        F share, way;  // way: -1 where they run backwards
    };
    static VR_HD Taps taps(F x, F n, U traits) {
        const M repeat = is(traits, kTraitRepeat), mirror = is(traits, kTraitMirror);
        const M nearest = is(traits, kTraitNearest);
        const F zero(0.f), one(1.f), last = n - one;
        const F turn = x - F(2.f) * floor(x * F(0.5f));  // in [0, 2]
        const F clamped = min(max(x, zero), one);
        const F s = select(repeat, x - floor(x), select(mirror, min(turn, F(2.f) - turn), clamped));
        const F place = fma(s, n, select(nearest, zero, F(-0.5f)));
        const F below = floor(place), above = below + one;
        const F low = select(below < zero, select(repeat, last, zero), below);
        const F high = select(above > last, select(repeat, zero, last), above);
        // min also keeps NaN within the texels.
        return {to_uint(min(low, last)), to_uint(min(high, last)),
                select(nearest, zero, place - below), select(mirror & (turn > one), -one, one)};
    }

    struct Texels {
        const uint32_t* words;
        U first, traits;
        M lanes;

        VR_HD S at(U texel) const {
            const M grey = is(traits, kTraitGrey), half = is(traits, kTraitHalf),
                    whole = is(traits, kTraitFloat);
            const U one = select(whole, U(4u), select(half, U(2u), U(1u)));
            const U all = select(whole, U(12u), select(half, U(8u), U(4u)));
            const U byte = texel * select(grey, one, all);
            const U at = select(lanes, first + (byte >> 2), U(0u));
            const U word = gather(words, at);
            S value = S::all(F(0.f));
            if (any(lanes & whole)) {
                // Of other lanes the words may lie behind the last one.
                const U step = select(lanes & whole & !grey, U(1u), U(0u));
                const S read{{as_float(word), as_float(gather(words, at + step)),
                              as_float(gather(words, at + step + step))}};
                value = select(whole, read, value);
            }
            if (any(lanes & half)) {
                const U step = select(lanes & half & !grey, U(1u), U(0u));
                const U second = gather(words, at + step);
                const U lower = select(grey & ((byte & U(2u)) == U(2u)), word >> 16, word);
                const S read{{of_half(lower), of_half(word >> 16), of_half(second)}};
                value = select(half, read, value);
            }
            const M codes = !(half | whole);
            if (any(lanes & codes)) {
                const U base = select(is(traits, kTraitSrgb), U(0u), U(256u));
                U shifted = select((byte & U(1u)) == U(1u), word >> 8, word);
                shifted = select((byte & U(2u)) == U(2u), shifted >> 16, shifted);
                const auto of_code = [&](U code) {
                    return as_float(gather(words, base + (code & U(255u))));
                };
                const S read{{of_code(shifted), of_code(word >> 8), of_code(word >> 16)}};
                value = select(codes, read, value);
            }
            return S::of([&](uint32_t k) { return select(grey, value[0], value[k]); });
        }
        // A finite half from 16 bits, exactly.
        static VR_HD F of_half(U bits) { return as_float((bits & U(0x7fffu)) << 13) * F(0x1p112f); }
    };
};

}  // namespace veriray
