// Grids of numbers in space by lane: rows of the grid table, and their values at a point.
//
// Along an axis of n cells, the centre of cell k is at (k + 1/2) / n of the grid's unit cube.
// Between centres values are interpolated, first along x, then y and z, in float32. As numbers of
// cells lie in [0, 1], so do values: with b - a rounded to nearest, a + s (b - a) is not below 0,
// and above 1 by less than rounding takes off.
#pragma once

#include "core/vec.h"
#include "textures/texture.h"

namespace veriray {

enum GridColumn : uint32_t {
    kGridToLocal,                  // what takes (p, 1) to the unit cube: 3 rows of 4
    kGridLow = kGridToLocal + 12,  // the box around the cube: 3 columns
    kGridHigh = kGridLow + 3,      // 3 columns
    kGridSize = kGridHigh + 3,     // cells along x, y and z: 3 columns
    kGridFirst = kGridSize + 3,    // its first number; bits
    kGridTraits,                   // of TextureTrait: repeat, mirror, nearest, grey; bits
    kGridColumns,
};

struct GridView {
    const float* table;  // [column][stride]
    uint32_t stride, count;
    const float* cells;
};

template <class L>
struct Grids : Textures<L> {
    using typename Textures<L>::F, typename Textures<L>::U, typename Textures<L>::M,
        typename Textures<L>::S;
    using V = Vec3<F>;

    struct Grid {
        V size;
        U first, traits;
    };
    static VR_HD F column(const GridView& grids, U row, uint32_t c) {
        return lookup(grids.table + static_cast<uint64_t>(c) * grids.stride, row, grids.count);
    }
    static VR_HD V columns(const GridView& grids, U row, uint32_t c) {
        return {column(grids, row, c), column(grids, row, c + 1), column(grids, row, c + 2)};
    }
    static VR_HD Grid grid(const GridView& grids, U row) {
        return {columns(grids, row, kGridSize), as_uint(column(grids, row, kGridFirst)),
                as_uint(column(grids, row, kGridTraits))};
    }
    // A point (w = 1) or a direction (w = 0) in the unit cube's coordinates.
    static VR_HD V local(const GridView& grids, U row, V p, float w) {
        const auto coordinate = [&](uint32_t c) {
            return dot(columns(grids, row, c), p) + column(grids, row, c + 3) * F(w);
        };
        return {coordinate(kGridToLocal), coordinate(kGridToLocal + 4),
                coordinate(kGridToLocal + 8)};
    }

    // The value at a point of the unit cube's coordinates where m is set.
    static VR_HD S value(const GridView& grids, const Grid& g, V at, M m) {
        using Base = Textures<L>;
        const auto x = Base::taps(at.x, g.size.x, g.traits),
                   y = Base::taps(at.y, g.size.y, g.traits),
                   z = Base::taps(at.z, g.size.z, g.traits);
        const U width = to_uint(g.size.x), area = width * to_uint(g.size.y);
        const M grey = Base::is(g.traits, kTraitGrey), coloured = m & !grey;
        const U step = select(grey, U(1u), U(3u));
        const auto cell = [&](U place) {
            const U i = select(m, g.first + place * step, U(0u));
            const F one = gather(grids.cells, i);
            if (none(coloured)) return S::all(one);
            const U next = select(coloured, U(1u), U(0u));
            return S{{one, gather(grids.cells, i + next), gather(grids.cells, i + next + next)}};
        };
        const auto row = [&](U start) {
            return Base::mix(cell(start + x.first), cell(start + x.second), x.share);
        };
        const auto layer = [&](U start) {
            return Base::mix(row(start + y.first * width), row(start + y.second * width), y.share);
        };
        return Base::mix(layer(z.first * area), layer(z.second * area), z.share);
    }
};

}  // namespace veriray
