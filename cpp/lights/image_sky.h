// An image around the scene: texels in rows of equal polar angle, the first at the local pole +y
// and the last at -y, in columns of equal azimuth with their centres half a column off the seam,
// which lies at -z; +x is a quarter further. Between texels the radiance is bilinear in the angles.
//
// It is sampled by cells of four texels. A row of cells is chosen, then a cell in it, by
// probabilities that are multiples of 2^-24, and a place in the cell in proportion to the bilinear
// interpolation of its corners' weights: the sum of the channels times the sine of the polar angle.
// At the poles the sine is 0, so that a pole's texel gives its sum to its neighbour away from the
// pole. Without `less`, the density is then positive where the radiance is, and hardly less than in
// proportion.
//
// With it, the default, a weight is what a texel's sum of channels exceeds `less` by, or 0. Where
// all weights are 0, the density is 0, and directions that closures and phase functions draw find
// the light, with weight 1: they can draw every direction in which they scatter (O. Karlik et al.,
// "MIS Compensation", SIGGRAPH Asia 2019).
#pragma once

#include "core/math.h"
#include "lights/shape.h"

namespace veriray {

template <class L>
struct ImageSky : LightShape<L> {
    VR_LIGHT_SHAPE(LightShape<L>);
    static constexpr const char *kName = "image_sky", *kFeature = "image_sky";
    static constexpr LightSite kSite = kAllAround;

    // The texels at the corners of a cell: left and right in the upper row, then in the lower one.
    struct Cell {
        F texel[4][kSkyFloats];
        F weight[4], mean;
        F chance;  // of the cell

        VR_HD S radiance(F s, F t) const {
            return S::of([&](uint32_t c) {
                return between(between(texel[0][c], texel[1][c], s),
                               between(texel[2][c], texel[3][c], s), t);
            });
        }
        // The density of places (s, t) in the cell.
        VR_HD F density(F s, F t) const {
            const F q =
                between(between(weight[0], weight[2], t), between(weight[1], weight[3], t), s);
            return select(mean > F(0.f), q / mean, F(0.f));
        }
    };
    // A direction: its cell, where in it, and the sine of its polar angle.
    struct Place {
        U column, row;
        F s, t, sine;
    };

    static VR_HD void read(const SkyMap& map, U index, F (&texel)[kSkyFloats]) {
        gather3(map.texels, index * U(kSkyFloats), texel);
    }
    static VR_HD Intervals<L> rows(const SkyMap& map) { return {map.ends, U(0u)}; }
    static VR_HD Intervals<L> columns(const SkyMap& map, U row) {
        return {map.ends, row * U(map.width) + U(map.height - 1u)};
    }

    // across, down: the sizes of the intervals of the cell in its row, and of the row.
    static VR_HD Cell cell(const SkyMap& map, U column, U row, F across, F down) {
        Cell c;
        const U beside = select(column + U(1u) < U(map.width), column + U(1u), U(0u));
        const U upper = row * U(map.width), lower = upper + U(map.width);
        read(map, upper + column, c.texel[0]), read(map, upper + beside, c.texel[1]);
        read(map, lower + column, c.texel[2]), read(map, lower + beside, c.texel[3]);
        const auto north = row == U(0u), south = row + U(2u) == U(map.height);
        const F sine_upper = gather(map.sines, row), sine_lower = gather(map.sines, row + U(1u));
        for (uint32_t k = 0; k < 2; ++k) {
            F a = c.texel[k][0] + c.texel[k][1] + c.texel[k][2];
            F b = c.texel[2 + k][0] + c.texel[2 + k][1] + c.texel[2 + k][2];
            if (map.less > 0.f) a = max(a - F(map.less), F(0.f)), b = max(b - F(map.less), F(0.f));
            c.weight[k] = select(south, a + b, a) * sine_upper;
            c.weight[2 + k] = select(north, a + b, b) * sine_lower;
        }
        c.mean = (c.weight[0] + c.weight[1] + (c.weight[2] + c.weight[3])) * F(0.25f);
        c.chance = (across * F(0x1p-24f)) * (down * F(0x1p-24f));
        return c;
    }

    template <class Row>
    static VR_HD Place place_of(const Row& row, V d) {
        const SkyMap& map = row.map;
        const V local{dot(row.vector(kLightP), d), dot(row.vector(kLightE1), d),
                      dot(row.vector(kLightE2), d)};
        Place at;
        at.sine = sqrt(fma(local.x, local.x, local.z * local.z));
        const F y = angle(local.y, at.sine) * F(map.rows_per_radian);
        const F x = fma(angle(-local.z, local.x), F(map.columns_per_radian), F(-0.5f));
        const F width(static_cast<float>(map.width));
        const F turned = select(x < F(0.f), x + width, x);
        at.column = to_uint(turned), at.row = to_uint(y);
        at.s = turned - to_float(at.column);
        // Rounding reaches the ends; a lane of no ray may hold anything.
        at.column = select(at.column < U(map.width), at.column, U(0u));
        at.row = select(at.row < U(map.height - 1u), at.row, U(map.height - 2u));
        at.t = min(y - to_float(at.row), F(1.f));
        return at;
    }

    template <class Row>
    static VR_HD S radiance(const Row& row, V d) {
        const Place at = place_of(row, d);
        return cell(row.map, at.column, at.row, F(0.f), F(0.f)).radiance(at.s, at.t) *
               F(row.map.shown);
    }
    // At the very poles, which are never drawn, it is 0.
    template <class Row>
    static VR_HD Pdf pdf_li(const Row& row, V d, V) {
        const Place at = place_of(row, d);
        return pdf_at(row, at, columns(row.map, at.row).size(at.column),
                      rows(row.map).size(at.row));
    }
    template <class Row>
    static VR_HD Pdf pdf_at(const Row& row, const Place& at, F across, F down) {
        const Cell c = cell(row.map, at.column, at.row, across, down);
        const auto pole = at.sine == F(0.f);
        return {select(pole, F(0.f), c.density(at.s, at.t) * c.chance),
                select(pole, F(1.f), row(kLightInverse) * F(row.map.cell) * at.sine)};
    }
    template <class Row>
    static VR_HD Sample sample_li(const Row& row, V, V, F u, F v, M, M nobody) {
        const SkyMap& map = row.map;
        Place at;
        F s, t, across, down;
        at.row = rows(map).choose(map.guides, U(0u), map.row_bits, v, t, down);
        const U guide = at.row * U((1u << map.column_bits) + 1u) + U((1u << map.row_bits) + 1u);
        at.column = columns(map, at.row).choose(map.guides, guide, map.column_bits, u, s, across);
        return sample_at(row, at, s, t, across, down, nobody);
    }
    // In a cell; s, t: random numbers.
    template <class Row>
    static VR_HD Sample sample_at(const Row& row, Place at, F s, F t, F across, F down, M nobody) {
        const SkyMap& map = row.map;
        const Cell c = cell(map, at.column, at.row, across, down);
        at.t = linear_place(c.weight[0] + c.weight[1], c.weight[2] + c.weight[3], t);
        at.s = linear_place(between(c.weight[0], c.weight[2], at.t),
                            between(c.weight[1], c.weight[3], at.t), s);
        const F x = (to_float(at.column) + (at.s + F(0.5f))) / F(static_cast<float>(map.width));
        const F y = (to_float(at.row) + at.t) / F(static_cast<float>(2u * (map.height - 1u)));
        F sine, cosine, right, along;
        sincos_2pi(y, sine, cosine);
        sincos_2pi(select(x < F(1.f), x, x - F(1.f)), right, along);
        const V wi = fma(row.vector(kLightP), sine * right,
                         fma(row.vector(kLightE1), cosine, row.vector(kLightE2) * -(sine * along)));
        const F inverse = row(kLightInverse) * F(map.cell) * sine;
        return {c.radiance(at.s, at.t) * F(map.shown),
                inverse / (c.density(at.s, at.t) * c.chance),
                F(kInfinity),
                wi,
                nobody,
                U(~0u)};
    }
    template <class Row>
    static VR_HD Emission emit(const Row& row, Numbers r) {
        const M nobody = r.s < F(0.f);
        const V any{r.s, r.s, r.s};
        const Sample s = sample_li(row, any, any, r.s, r.t, nobody, nobody);
        const F chance = F(1.f) / row(kLightInverse);
        return {
            Base::before_scene(-s.wi, r.u, r.v), -s.wi, s.radiance, F(1.f), chance / F(kSceneArea),
            F(1.f) / (s.inverse_pdf * chance)};
    }
    // Across a disc of radius 1, as of a directional light. strength: the mean over the sphere.
    static VR_HD double power(const LightSource& s) {
        return 4 * kPiDouble * kPiDouble * s.strength;
    }
    static LightBound bound(const LightSource& s) {
        return {{0, 0, 1}, kFromAllAround, {0, 0, 0}, -1, 0, kPiDouble * s.strength * s.seen};
    }
    // The images of the local axes.
    template <class At>
    static void write(const LightSource& s, At at) {
        Base::write3(at, kLightP, s.p);
        Base::write3(at, kLightE1, s.e1);
        Base::write3(at, kLightE2, s.e2);
    }
};

}  // namespace veriray
