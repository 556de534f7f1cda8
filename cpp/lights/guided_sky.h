// An image around a scene that sees it through openings, as a room by daylight. The light samples
// of image_sky.h would mostly be blocked there.
//
// Directions are drawn by patches of the sky, in proportion to their light and to how often they
// are seen from points near the receiver: by tables of the scene's places (scene/sky_guide.cpp),
// which leave every patch with light a chance. A row of patches is chosen, a patch in it, one of
// its rows of cells, and a cell. The density is that of the tables, so that what they say of
// visibility changes noise, never means. After B. Bitterli, J. Novak, W. Jarosz, "Portal-Masked
// Environment Map Sampling", EGSR 2015, where users give the openings.
#pragma once

#include "lights/image_sky.h"

namespace veriray {

template <class L>
struct GuidedSky : ImageSky<L> {
    VR_LIGHT_SHAPE(ImageSky<L>);
    using typename Base::Place;
    static constexpr const char *kName = "guided_sky", *kFeature = "guided_sky";

    // The chances of a place.
    struct Chances {
        Intervals<L> rows;
        U patches;  // where its table of patches begins

        VR_HD Chances(const SkyGuide& g, V p)
            : rows{g.places, table(g, p)}, patches(rows.base + U(g.patch_rows)) {}
        VR_HD Intervals<L> in_row(const SkyGuide& g, U row) const {
            return {g.places, patches + row * U(g.patch_columns)};
        }

       private:
        static VR_HD U table(const SkyGuide& g, V p) {
            const F at[3] = {(p.x - F(g.low[0])) * F(g.per_length[0]),
                             (p.y - F(g.low[1])) * F(g.per_length[1]),
                             (p.z - F(g.low[2])) * F(g.per_length[2])};
            M within = at[0] >= F(0.f);
            for (uint32_t k = 0; k < 3; ++k)
                within = within & (at[k] >= F(0.f)) & (at[k] < F(static_cast<float>(g.along[k])));
            U place(0u);
            for (uint32_t k = 3; k-- > 0;)
                place = place * U(g.along[k]) + to_uint(select(within, at[k], F(0.f)));
            const uint32_t elsewhere = g.along[0] * g.along[1] * g.along[2];
            return select(within, place, U(elsewhere)) * U(g.patch_rows * (1u + g.patch_columns));
        }
    };
    static VR_HD Intervals<L> rows_in(const SkyGuide& g, U row, U column) {
        return {g.rows, (row * U(g.patch_columns) + column) << g.row_bits};
    }
    // Where in a row of cells a patch begins and ends, as `columns` counts.
    struct Span {
        U first, last;
        F begin, total;

        VR_HD Span(const SkyMap& map, U row, U column)
            : first(column << map.guide.column_bits),
              last(select(first + U(1u << map.guide.column_bits) < U(map.width),
                          first + U((1u << map.guide.column_bits) - 1u), U(map.width - 1u))),
              begin(Base::columns(map, row).start(first)),
              total(Base::columns(map, row).end(last) - begin) {}
    };
    // A number in [0, 1] in units of 2^-24, below 2^24.
    static VR_HD F units(F rest) {
        return to_float(to_uint(min(rest * F(0x1p24f), F(0x1.fffffep23f))));
    }

    template <class Row>
    static VR_HD Pdf pdf_li(const Row& row, V d, V from) {
        const SkyMap& map = row.map;
        const SkyGuide& g = map.guide;
        const Place at = Base::place_of(row, d);
        const U r = at.row >> g.row_bits, c = at.column >> g.column_bits;
        const Chances chances(g, from);
        const Span span(map, at.row, c);
        const F down = (chances.rows.size(r) * F(0x1p-24f)) *
                       (chances.in_row(g, r).size(c) * F(0x1p-24f)) *
                       rows_in(g, r, c).size(at.row & U((1u << g.row_bits) - 1u));
        const F across = Base::columns(map, at.row).size(at.column) * F(0x1p24f);
        return Base::pdf_at(row, at, select(span.total > F(0.f), across / span.total, F(0.f)),
                            down);
    }
    template <class Row>
    static VR_HD Sample sample_li(const Row& row, V, V from, F u, F v, M, M nobody) {
        const SkyMap& map = row.map;
        const SkyGuide& g = map.guide;
        const Chances chances(g, from);
        F s, t, size, down;
        const U r = chances.rows.find(U(0u), U(g.patch_rows - 1u), v * F(0x1p24f), t, down);
        const U c =
            chances.in_row(g, r).find(U(0u), U(g.patch_columns - 1u), u * F(0x1p24f), s, size);
        down = (down * F(0x1p-24f)) * (size * F(0x1p-24f));
        const U line = rows_in(g, r, c).find(U(0u), U((1u << g.row_bits) - 1u), units(t), t, size);
        down = down * size;
        Place at;
        at.row = (r << g.row_bits) + line;
        const Span span(map, at.row, c);
        const F u24 = to_float(to_uint(s * span.total));
        at.column =
            Base::columns(map, at.row)
                .find(span.first, span.last, span.begin + min(u24, span.total - F(1.f)), s, size);
        return Base::sample_at(row, at, s, t, size * F(0x1p24f) / span.total, down, nobody);
    }
};

}  // namespace veriray
