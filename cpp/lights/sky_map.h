// The texels of an image around the scene (image_sky.h), and the tables by which it is sampled.
#pragma once

#include "core/intervals.h"

namespace veriray {

inline constexpr uint32_t kSkyFloats = 3;  // of a texel

struct SkyMap {
    const float* texels;     // radiance
    const float* ends;       // of intervals: of the rows of cells, then of the cells by row
    const float* sines;      // of the polar angle, by row of texels
    const uint32_t* guides;  // of the rows, then by row
    uint32_t width, height;  // texels; rows of cells are one less
    uint32_t row_bits, column_bits;
    float rows_per_radian, columns_per_radian;
    float cell;   // the size of a cell in square radians
    float shown;  // 1; 0 if its light is left out
    float less;   // what the density leaves out of a texel's sum of channels; 0: nothing
};

}  // namespace veriray
