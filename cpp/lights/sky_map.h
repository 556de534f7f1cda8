// The texels of an image around the scene (image_sky.h), and the tables by which it is sampled.
#pragma once

#include "core/intervals.h"

namespace veriray {

inline constexpr uint32_t kSkyFloats = 3;  // of a texel

// How directions are drawn where the sky is seen through openings (guided_sky.h). Places are boxes
// of a grid in the scene, patches are blocks of cells of the sky.
struct SkyGuide {
    const float* places;  // by place, and last for points elsewhere: ends of intervals of the rows
                          // of patches, then of the patches by row
    const float* rows;    // by patch: of its rows of cells
    float low[3], per_length[3];         // of the grid: its corner, and places by length
    uint32_t along[3];                   // places
    uint32_t patch_rows, patch_columns;  // of patches
    uint32_t row_bits, column_bits;      // a patch has 2^bits rows and columns of cells
};

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
    SkyGuide guide;
};

}  // namespace veriray
