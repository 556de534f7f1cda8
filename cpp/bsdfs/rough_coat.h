// Numbers of rough surfaces that the host makes: their slopes, and tables (scene/surfaces.cpp).
#pragma once

#include "spectrum/spectrum.h"

namespace veriray {

inline constexpr uint32_t kCoatCells = 63;  // of the table of what a rough coat lets in

// Share of the light at this cosine that the mirrors of a rough interface send through it, or back,
// in one step and past Smith's shadows. eta: index beyond over index here.
double rough_share(bool through, float cosine, float eta, float alpha, bool ggx, bool correlated);

// Smith's G2 across a surface over the product of both G1, where heights count.
float common_shadows(float a, float b);

// How closures are told a distribution of slopes and its shadows: above 0 for GGX, else Beckmann's;
// beyond 1 on either side if the shadows are correlated by height.
constexpr float slopes_number(bool ggx, bool correlated) {
    return ggx ? (correlated ? 2.f : 1.f) : (correlated ? -2.f : 0.f);
}

// The table of a surface that makes up for what its mirrors lose (bsdfs/lost_light.h); two columns
// are of a metal alone, or of an interface alone.
inline constexpr uint32_t kLostCells = 255;
enum LostColumn : uint32_t {
    kLostMean,        // of diffuse light, in front
    kThrough,         // share of what is lost in front that goes to the other side
    kLostMeanBehind,  // likewise, from behind
    kThroughBehind,
    kReflectedMean = kThrough,  // of a metal, Fresnel's for diffuse light: one for each channel
    kLostAtCosine = 1 + (kChannels > 3 ? kChannels : 3),  // at kLostCells + 1 cosines, in front
    kLostBehind = kLostAtCosine + kLostCells + 1,
};

}  // namespace veriray
