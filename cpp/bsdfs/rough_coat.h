// Tables of rough coats, which the host makes (scene/surfaces.cpp).
#pragma once

#include <cstdint>

namespace veriray {

inline constexpr uint32_t kCoatCells = 63;  // of the table of what a rough coat lets in

// Share of the light at this cosine that the mirrors of a rough interface send through it, or back,
// in one step and past Smith's shadows. eta: index beyond over index here.
double rough_share(bool through, float cosine, float eta, float alpha, bool ggx);

}  // namespace veriray
