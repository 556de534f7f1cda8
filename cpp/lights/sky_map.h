// The texels of an image around the scene, and choices by tables.
#pragma once

#include "core/lane.h"

namespace veriray {

// An image around the scene (image_sky.h). Upper ends of choice intervals are integers, in units
// of 2^-24; the last of a row of cells that can be chosen is 2^24.
inline constexpr uint32_t kSkyFloats = 4, kSkyEnd = 3;  // a texel: radiance; a cell's upper end
inline constexpr uint32_t kSkyRowFloats = 2;            // a row's upper end; its sine
struct SkyMap {
    const float* texels;
    const float* rows;
    uint32_t width, height;          // texels
    uint32_t row_step, column_step;  // largest powers of two <= rows of cells, columns
    float rows_per_radian, columns_per_radian;
    float cell;  // the size of a cell in square radians
};

// The interval of `count` that holds u24, by their upper ends. top_step: the largest power of two
// <= count.
template <class U, class Number, class End>
VR_HD U choose_interval(uint32_t count, uint32_t top_step, Number u24, End end) {
    U first(0u);
    for (uint32_t step = top_step; step; step >>= 1) {
        const U next = first + U(step);
        const auto valid = next < U(count + 1u);
        const Number upper = end(select(valid, next, U(1u)) + U(~0u));
        first = select(valid & !(u24 < upper), next, first);
    }
    return first;
}

// A place in [0, 1] of a density that is linear between the weights a and b at the ends.
template <class F>
VR_HD F linear_place(F a, F b, F u) {
    const F total = a + b, from = a / total, to = b / total;
    const F root = sqrt(fma(u, to * to, (F(1.f) - u) * (from * from)));
    return min(u / (from + root), F(1.f));
}
// From a to b; exactly a where they are equal.
template <class F>
VR_HD F between(F a, F b, F u) {
    return fma(u, b - a, a);
}

}  // namespace veriray
