// Colours by channel: radiance, throughput, reflectance, extinction. They are not positions or
// directions: Spectrum and Vec3 do not convert into each other.
#pragma once

#include <type_traits>

#include "core/vec.h"

namespace veriray {

inline constexpr uint32_t kChannels = 3;  // of a film: red, green, blue

// kCount channels of lanes.
template <class F, uint32_t kCount = kChannels>
struct Spectrum {
    static_assert(kCount == 3 || kCount == 4);
    F channel[kCount];

    VR_HD const F& operator[](uint32_t k) const { return channel[k]; }
    VR_HD F& operator[](uint32_t k) { return channel[k]; }

    // value(k) in channel k.
    template <class Value>
    static VR_HD Spectrum of(Value value) {
        if constexpr (kCount == 3)
            return {{value(0u), value(1u), value(2u)}};
        else
            return {{value(0u), value(1u), value(2u), value(3u)}};
    }
    static VR_HD Spectrum all(F x) {
        return of([&](uint32_t) { return x; });
    }
    // Consecutive numbers, equal in all lanes, or lanes.
    template <class Number>
    static VR_HD Spectrum from(const Number* p) {
        return of([&](uint32_t k) { return F(p[k]); });
    }
};

static_assert(!std::is_convertible_v<Vec3<float>, Spectrum<float>> &&
              !std::is_convertible_v<Spectrum<float>, Vec3<float>>);

template <class F, uint32_t n>
VR_HD Spectrum<F, n> operator+(const Spectrum<F, n>& a, const Spectrum<F, n>& b) {
    return Spectrum<F, n>::of([&](uint32_t k) { return a[k] + b[k]; });
}
template <class F, uint32_t n>
VR_HD Spectrum<F, n> operator*(const Spectrum<F, n>& a, const Spectrum<F, n>& b) {
    return Spectrum<F, n>::of([&](uint32_t k) { return a[k] * b[k]; });
}
template <class F, uint32_t n>
VR_HD Spectrum<F, n> operator*(const Spectrum<F, n>& a, F s) {
    return Spectrum<F, n>::of([&](uint32_t k) { return a[k] * s; });
}
template <class F, uint32_t n>
VR_HD Spectrum<F, n> fma(const Spectrum<F, n>& a, F s, const Spectrum<F, n>& b) {
    return Spectrum<F, n>::of([&](uint32_t k) { return fma(a[k], s, b[k]); });
}
template <class F, uint32_t n>
VR_HD Spectrum<F, n> fma(const Spectrum<F, n>& a, const Spectrum<F, n>& b,
                         const Spectrum<F, n>& c) {
    return Spectrum<F, n>::of([&](uint32_t k) { return fma(a[k], b[k], c[k]); });
}
template <class F, class M, uint32_t n>
VR_HD Spectrum<F, n> select(M m, const Spectrum<F, n>& a, const Spectrum<F, n>& b) {
    return Spectrum<F, n>::of([&](uint32_t k) { return select(m, a[k], b[k]); });
}
template <class F, uint32_t n>
VR_HD F max_channel(const Spectrum<F, n>& a) {
    F most = max(max(a[0], a[1]), a[2]);
    if constexpr (n == 4) most = max(most, a[3]);
    return most;
}
template <class F, uint32_t n>
VR_HD F sum(const Spectrum<F, n>& a) {
    F all = a[0] + a[1] + a[2];
    if constexpr (n == 4) all = all + a[3];
    return all;
}
// The channels over their sum. Sums below 2^-100, whose inverse may overflow, are scaled first.
template <class F, uint32_t n>
VR_HD Spectrum<F, n> shares(const Spectrum<F, n>& a) {
    const F total = sum(a), scale = select(total < F(0x1p-100f), F(0x1p100f), F(1.f));
    return a * scale * (F(1.f) / (total * scale));
}
// Sum of products, fused.
template <class F, uint32_t n>
VR_HD F inner(const Spectrum<F, n>& a, const Spectrum<F, n>& b) {
    F all = fma(a[2], b[2], fma(a[1], b[1], a[0] * b[0]));
    if constexpr (n == 4) all = fma(a[3], b[3], all);
    return all;
}
// The value of a channel chosen with these weights, which add up to 1, by u in [0, 1).
template <class F, uint32_t n>
VR_HD F choose(const Spectrum<F, n>& value, const Spectrum<F, n>& weight, F u) {
    F other = value[n - 1];
    if constexpr (n == 4) other = select(u < weight[0] + weight[1] + weight[2], value[2], other);
    return select(u < weight[0], value[0], select(u < weight[0] + weight[1], value[1], other));
}

}  // namespace veriray
