// What the texture of a light amounts to, for the choice among lights and for the film's scale.
#pragma once

#include "scene/scene.h"

namespace veriray {

// Where a texture is read: a box of coordinates, and the triangles there, none of other shapes.
struct LitArea {
    std::vector<Double3> corners;  // x is u, y is v, affine functions of the place
    std::vector<uint32_t> triangles;
};

// The sums of a texture's texels by cells, of which it has at most 256 along an axis.
class LightTexture {
   public:
    LightTexture(const SceneInput& in, size_t texture);

    // A number that no colour of the texture exceeds in any channel.
    float largest() const { return largest_; }
    // The mean of all channels over the texels that are read in an area, or more: it is 0 only
    // where the texture is black in all of it.
    double mean(const SceneInput& in, const LitArea& area) const;
    // Of an area that is not flat, or of an image.
    double mean(const SceneInput& in) const;

   private:
    // Texels from first to last, and how many the cells hold that cover them.
    struct Span {
        uint32_t first, last;
    };
    struct Axis {
        uint32_t texels, cells;
        uint32_t cell(uint32_t texel) const {
            return static_cast<uint32_t>(uint64_t{texel} * cells / texels);
        }
        uint32_t start(uint32_t cell) const {
            return static_cast<uint32_t>((uint64_t{cell} * texels + cells - 1) / cells);
        }
    };
    double of_triangles(const SceneInput& in, const std::vector<uint32_t>& triangles) const;
    std::vector<Span> spans(double low, double high, uint32_t n) const;

    double to_uv_[6];
    uint32_t wrap_ = 0;
    Axis x_{1, 1}, y_{1, 1};
    std::vector<double> sums_;  // of all cells before a row and a column
    float largest_ = 0;
    std::vector<LightTexture> fields_;  // textures in half of a checkerboard's fields each
    uint32_t attribute_ = 0;            // its kind if it is one
    size_t first_ = 0;                  // and its first row of numbers
};

}  // namespace veriray
