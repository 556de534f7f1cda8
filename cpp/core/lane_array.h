// Four lanes as plain arrays: any processor, and the plainest statement of what a lane type does.
#pragma once

namespace veriray {

inline constexpr uint32_t kArrayWidth = 4;

struct M4 {
    uint32_t m;
};
template <class T>
struct Array4 {
    T v[kArrayWidth];
    Array4() = default;
    VR_HD Array4(T a) {
        for (T& x : v) x = a;
    }
};
using F4 = Array4<float>;
using U4 = Array4<uint32_t>;

struct Simd {
    using F = F4;
    using U = U4;
    using M = M4;
    static constexpr uint32_t kWidth = kArrayWidth;
};

using Batch = Simd;

template <class R, class Fn>
VR_HD R each_lane(Fn fn) {
    R r;
    for (uint32_t i = 0; i < kArrayWidth; ++i) r.v[i] = fn(i);
    return r;
}
template <class Fn>
VR_HD M4 each_bit(Fn fn) {
    M4 r{0};
    for (uint32_t i = 0; i < kArrayWidth; ++i) r.m |= (fn(i) ? 1u : 0u) << i;
    return r;
}

#define VR_LANE_BINARY(T, op)                                              \
    VR_HD T operator op(T a, T b) {                                        \
        return each_lane<T>([&](uint32_t i) { return a.v[i] op b.v[i]; }); \
    }
#define VR_LANE_COMPARE(T, op)                                         \
    VR_HD M4 operator op(T a, T b) {                                   \
        return each_bit([&](uint32_t i) { return a.v[i] op b.v[i]; }); \
    }
VR_LANE_BINARY(F4, +)
VR_LANE_BINARY(F4, -)
VR_LANE_BINARY(F4, *)
VR_LANE_BINARY(F4, /)
VR_LANE_COMPARE(F4, <)
VR_LANE_COMPARE(F4, <=)
VR_LANE_COMPARE(F4, >)
VR_LANE_COMPARE(F4, >=)
VR_LANE_COMPARE(F4, ==)
VR_LANE_BINARY(U4, +)
VR_LANE_BINARY(U4, *)
VR_LANE_BINARY(U4, &)
VR_LANE_BINARY(U4, |)
VR_LANE_BINARY(U4, ^)
VR_LANE_COMPARE(U4, ==)
VR_LANE_COMPARE(U4, <)
#undef VR_LANE_BINARY
#undef VR_LANE_COMPARE
VR_HD F4 operator-(F4 a) {
    return each_lane<F4>([&](uint32_t i) { return -a.v[i]; });
}
VR_HD U4 operator>>(U4 a, int n) {
    return each_lane<U4>([&](uint32_t i) { return a.v[i] >> n; });
}
VR_HD U4 operator<<(U4 a, int n) {
    return each_lane<U4>([&](uint32_t i) { return a.v[i] << n; });
}
VR_HD M4 operator&(M4 a, M4 b) { return {a.m & b.m}; }
VR_HD M4 operator|(M4 a, M4 b) { return {a.m | b.m}; }
VR_HD M4 operator!(M4 a) { return {~a.m & ((1u << kArrayWidth) - 1u)}; }

VR_HD F4 fma(F4 a, F4 b, F4 c) {
    return each_lane<F4>([&](uint32_t i) { return fma(a.v[i], b.v[i], c.v[i]); });
}
VR_HD F4 sqrt(F4 a) {
    return each_lane<F4>([&](uint32_t i) { return sqrt(a.v[i]); });
}
VR_HD F4 abs(F4 a) {
    return each_lane<F4>([&](uint32_t i) { return abs(a.v[i]); });
}
VR_HD F4 min(F4 a, F4 b) {
    return each_lane<F4>([&](uint32_t i) { return min(a.v[i], b.v[i]); });
}
VR_HD F4 max(F4 a, F4 b) {
    return each_lane<F4>([&](uint32_t i) { return max(a.v[i], b.v[i]); });
}
template <class T>
VR_HD Array4<T> select(M4 m, Array4<T> a, Array4<T> b) {
    return each_lane<Array4<T>>([&](uint32_t i) { return (m.m >> i) & 1u ? a.v[i] : b.v[i]; });
}
VR_HD F4 select(M4 m, F4 a, F4 b) { return select<float>(m, a, b); }
VR_HD U4 select(M4 m, U4 a, U4 b) { return select<uint32_t>(m, a, b); }
VR_HD M4 and_less(M4 m, F4 a, F4 b) { return m & (a < b); }
VR_HD M4 and_less_equal(M4 m, F4 a, F4 b) { return m & (a <= b); }
VR_HD bool any(M4 m) { return m.m != 0; }
VR_HD bool none(M4 m) { return m.m == 0; }
VR_HD uint32_t bits(M4 m) { return m.m; }
VR_HD uint32_t count(M4 m) { return static_cast<uint32_t>(__builtin_popcount(m.m)); }
VR_HD F4 to_float(U4 a) {
    return each_lane<F4>([&](uint32_t i) { return to_float(a.v[i]); });
}
VR_HD U4 to_uint(F4 a) {
    return each_lane<U4>([&](uint32_t i) { return to_uint(a.v[i]); });
}
VR_HD U4 as_uint(F4 a) { return bit_cast<U4>(a); }
VR_HD F4 as_float(U4 a) { return bit_cast<F4>(a); }
VR_HD F4 gather(const float* p, U4 i) {
    return each_lane<F4>([&](uint32_t k) { return p[i.v[k]]; });
}
VR_HD U4 gather(const uint32_t* p, U4 i) {
    return each_lane<U4>([&](uint32_t k) { return p[i.v[k]]; });
}
VR_HD F4 lookup(const float* column, U4 i, uint32_t) { return gather(column, i); }
VR_HD F4 load(const float* p, F4) {
    return each_lane<F4>([&](uint32_t i) { return p[i]; });
}
VR_HD U4 load(const uint32_t* p, U4) {
    return each_lane<U4>([&](uint32_t i) { return p[i]; });
}
template <class T>
VR_HD void store(T* p, Array4<T> a) {
    for (uint32_t i = 0; i < kArrayWidth; ++i) p[i] = a.v[i];
}
VR_HD M4 first_lanes(uint32_t n, M4) {
    return each_bit([&](uint32_t i) { return i < n; });
}
VR_HD M4 mask_of(uint32_t m, M4) { return {m & ((1u << kArrayWidth) - 1u)}; }
template <class T>
VR_HD void compress_store(T* p, Array4<T> a, M4 m) {
    for (uint32_t i = 0; i < kArrayWidth; ++i)
        if ((m.m >> i) & 1u) *p++ = a.v[i];
}

}  // namespace veriray
