#include "scene/light_texture.h"

#include <algorithm>

#include "textures/srgb.h"

namespace veriray {
namespace {

// A texel's channels; all three of a grey one.
void read_texel(const SceneInput& in, size_t t, size_t texel, float rgb[3]) {
    const uint32_t format = in.texture_format.data[t];
    const bool grey = in.texture_grey.data[t] != 0;
    const size_t step = texel_bytes(format, grey);
    const size_t each = format == kFloat ? 4 : format == kHalf ? 2 : 1;
    for (size_t c = 0; c < 3; ++c) {
        const size_t byte = texel * step + (grey ? 0 : c * each);
        const uint32_t word = in.texels.data[in.texture_first.data[t] + byte / 4];
        const uint32_t bits = word >> (8 * (byte % 4));
        rgb[c] = format == kFloat   ? bit_cast<float>(word)
                 : format == kHalf  ? bit_cast<float>((bits & 0x7fffu) << 13) * 0x1p112f
                 : format == kSrgb8 ? kLinearOfSrgb[bits & 255u]
                                    : static_cast<float>(bits & 255u) / 255.f;
    }
}

}  // namespace

LightTexture::LightTexture(const SceneInput& in, size_t t) : wrap_(in.texture_wrap.data[t]) {
    for (size_t k = 0; k < 6; ++k)
        to_uv_[k] = static_cast<double>(in.texture_to_uv.data[6 * t + k]);
    std::vector<double> cells;
    const uint32_t kind = in.texture_kind.data[t];
    if (kind == kCheckerboard) {  // its fields everywhere, in equal shares
        double sum = 0;
        const bool own[2] = {in.texture_field0.data[t] < 0, in.texture_field1.data[t] < 0};
        for (size_t k = 0; k < 3; ++k) {
            const float a = own[0] ? in.texture_color0.data[3 * t + k] : 0.f,
                        b = own[1] ? in.texture_color1.data[3 * t + k] : 0.f;
            sum += (static_cast<double>(a) + static_cast<double>(b)) / 6;
            largest_ = std::max({largest_, a, b});
        }
        cells = {sum};
        for (const int32_t field : {in.texture_field0.data[t], in.texture_field1.data[t]}) {
            if (field < 0) continue;
            fields_.emplace_back(in, static_cast<size_t>(field));
            largest_ = std::max(largest_, fields_.back().largest());
        }
    } else if (kind == kVolume) {  // its texels everywhere, in equal shares
        const size_t count =
            size_t{in.texture_width.data[t]} * in.texture_height.data[t] * in.texture_depth.data[t];
        double sum = 0;
        for (size_t i = 0; i < count; ++i) {
            float rgb[3];
            read_texel(in, t, i, rgb);
            for (const float c : rgb)
                sum += static_cast<double>(c) / 3, largest_ = std::max(largest_, c);
        }
        cells = {sum / static_cast<double>(count)};
    } else if (kind != kBitmap) {
        attribute_ = kind, first_ = in.texture_first.data[t];
        const size_t rows = kind == kFaceAttribute ? in.triangles_rows() : in.vertices_rows();
        const float* values = in.attribute_values.data + 3 * first_;
        for (size_t i = 0; i < 3 * rows; ++i) largest_ = std::max(largest_, values[i]);
        cells = {0};
    } else {
        const uint32_t w = in.texture_width.data[t], h = in.texture_height.data[t];
        x_ = {w, std::min(w, 256u)}, y_ = {h, std::min(h, 256u)};
        cells.assign(size_t{x_.cells} * y_.cells, 0);
        for (uint32_t y = 0; y < h; ++y)
            for (uint32_t x = 0; x < w; ++x) {
                float rgb[3];
                read_texel(in, t, size_t{y} * w + x, rgb);
                double sum = 0;
                for (const float c : rgb)
                    sum += static_cast<double>(c) / 3, largest_ = std::max(largest_, c);
                cells[size_t{y_.cell(y)} * x_.cells + x_.cell(x)] += sum;
            }
    }
    const size_t stride = size_t{x_.cells} + 1;
    sums_.assign(stride * (y_.cells + size_t{1}), 0);
    for (uint32_t y = 0; y < y_.cells; ++y) {
        double row = 0;
        for (uint32_t x = 0; x < x_.cells; ++x) {
            row += cells[size_t{y} * x_.cells + x];
            sums_[(y + 1) * stride + x + 1] = sums_[y * stride + x + 1] + row;
        }
    }
}

// Along an axis of n texels; both neighbours of a coordinate count.
std::vector<LightTexture::Span> LightTexture::spans(double low, double high, uint32_t n) const {
    const Span all{0, n - 1};
    const double first = std::floor(low * n - 0.5), last = std::floor(high * n - 0.5) + 1;
    const double most = n - 1;
    if (wrap_ == kClamp && first <= last)
        return {{static_cast<uint32_t>(std::clamp(first, 0.0, most)),
                 static_cast<uint32_t>(std::clamp(last, 0.0, most))}};
    const double turn = std::floor(first / n), a = first - turn * n, b = last - turn * n;
    if (!(b - a < most) || !(a >= 0 && a <= most)) return {all};
    const uint32_t from = static_cast<uint32_t>(a), to = static_cast<uint32_t>(b);
    if (wrap_ == kMirror) {
        if (to >= n) return {all};
        if (turn != 2 * std::floor(turn / 2)) return {{n - 1 - to, n - 1 - from}};
    }
    if (to < n) return {{from, to}};
    return {{from, n - 1}, {0, to - n}};
}

// Of the numbers at the corners of triangles, or of these.
double LightTexture::of_triangles(const SceneInput& in,
                                  const std::vector<uint32_t>& triangles) const {
    double sum = 0, count = 0;
    const auto add = [&](size_t row) {
        const float* values = in.attribute_values.data + 3 * (first_ + row);
        for (size_t k = 0; k < 3; ++k) sum += static_cast<double>(values[k]);
        count += 3;
    };
    for (const size_t triangle : triangles) {
        if (attribute_ == kFaceAttribute) {
            add(triangle);
            continue;
        }
        for (size_t c = 0; c < 3; ++c) add(in.triangles.data[3 * triangle + c]);
    }
    return count > 0 ? sum / count : 0;
}

double LightTexture::mean(const SceneInput& in, const LitArea& area) const {
    if (attribute_ != kBitmap) return of_triangles(in, area.triangles);
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (const Double3& at : area.corners)
        for (int k = 0; k < 2; ++k) {
            const double* m = to_uv_ + 3 * k;
            const double x = m[0] * at.x + m[1] * at.y + m[2];
            low[k] = std::min(low[k], x), high[k] = std::max(high[k], x);
        }
    const size_t stride = size_t{x_.cells} + 1;
    double sum = 0, count = 0;
    for (const Span& v : spans(low[1], high[1], y_.texels))
        for (const Span& u : spans(low[0], high[0], x_.texels)) {
            const uint32_t x0 = x_.cell(u.first), x1 = x_.cell(u.last) + 1;
            const uint32_t y0 = y_.cell(v.first), y1 = y_.cell(v.last) + 1;
            sum += sums_[y1 * stride + x1] - sums_[y0 * stride + x1] - sums_[y1 * stride + x0] +
                   sums_[y0 * stride + x0];
            count +=
                static_cast<double>(x_.start(x1) - x_.start(x0)) * (y_.start(y1) - y_.start(y0));
        }
    double all = std::max(sum, 0.0) / count;
    for (const LightTexture& field : fields_) all += field.mean(in, area) / 2;
    return all;
}

double LightTexture::mean(const SceneInput& in) const {
    return mean(in, {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, {}});
}

}  // namespace veriray
