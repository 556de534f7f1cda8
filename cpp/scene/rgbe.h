// Scan lines of Radiance's pictures.
#pragma once

#include <cstdint>
#include <string_view>

namespace veriray {

// Reads lines that are run-length coded by channel (G. Ward, "Real pixels", Graphics Gems II, 1991)
// into red, green and blue of each pixel. False if a line is damaged or cut off.
bool read_rgbe(std::string_view lines, uint32_t width, uint32_t height, float* out);

}  // namespace veriray
