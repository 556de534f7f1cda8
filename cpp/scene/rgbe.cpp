#include "scene/rgbe.h"

#include <cmath>
#include <cstring>
#include <vector>

namespace veriray {
namespace {

using Byte = unsigned char;

// A line's bytes by channel from p on; where the next begins, or null.
const Byte* read_line(const Byte* p, const Byte* end, uint32_t width, Byte* channels) {
    const Byte mark[4] = {2, 2, static_cast<Byte>(width >> 8), static_cast<Byte>(width & 255)};
    if (end - p < 4 || std::memcmp(p, mark, 4) != 0) return nullptr;
    p += 4;
    for (uint32_t channel = 0; channel < 4; ++channel)
        for (uint32_t left = width; left;) {
            if (end - p < 2) return nullptr;
            const bool run = *p > 128;
            const uint32_t count = run ? *p - 128u : *p;
            ++p;
            if (!count || count > left || (!run && end - p < static_cast<ptrdiff_t>(count)))
                return nullptr;
            if (run)
                std::memset(channels, *p++, count);
            else
                std::memcpy(channels, p, count), p += count;
            channels += count, left -= count;
        }
    return p;
}

}  // namespace

bool read_rgbe(std::string_view lines, uint32_t width, uint32_t height, float* out) {
    float scale[256] = {0.f};  // by exponent
    for (int e = 1; e < 256; ++e) scale[e] = std::ldexp(1.f, e - (128 + 8));
    const Byte* p = reinterpret_cast<const Byte*>(lines.data());
    const Byte* const end = p + lines.size();
    std::vector<Byte> channels(size_t{4} * width);
    for (uint32_t y = 0; y < height; ++y) {
        p = read_line(p, end, width, channels.data());
        if (!p) return false;
        for (uint32_t x = 0; x < width; ++x)
            for (uint32_t c = 0; c < 3; ++c)
                *out++ = channels[size_t{c} * width + x] * scale[channels[size_t{3} * width + x]];
    }
    return true;
}

}  // namespace veriray
