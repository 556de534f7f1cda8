// Sixteen lanes on AVX-512 (x86-64-v4).
#pragma once

// GCC 12 takes the undefined operands of its own intrinsics for uninitialised variables.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#include <immintrin.h>
#pragma GCC diagnostic pop

namespace veriray {

struct M16 {
    __mmask16 m;
};
struct U16 {
    __m512i v;
    U16() = default;
    VR_HD U16(__m512i a) : v(a) {}
    VR_HD U16(uint32_t a) : v(_mm512_set1_epi32(static_cast<int>(a))) {}
};
struct F16 {
    __m512 v;
    F16() = default;
    VR_HD F16(__m512 a) : v(a) {}
    VR_HD F16(float a) : v(_mm512_set1_ps(a)) {}
};

struct D16 {
    __m512d low, high;
    D16(__m512d a, __m512d b) : low(a), high(b) {}
    VR_HD D16(double a) : low(_mm512_set1_pd(a)), high(low) {}
};

struct Simd {
    using F = F16;
    using D = D16;
    using U = U16;
    using M = M16;
    using Uniform = float;
    static constexpr uint32_t kWidth = 16;
};

VR_HD F16 operator+(F16 a, F16 b) { return _mm512_add_ps(a.v, b.v); }
VR_HD F16 operator-(F16 a, F16 b) { return _mm512_sub_ps(a.v, b.v); }
VR_HD F16 operator*(F16 a, F16 b) { return _mm512_mul_ps(a.v, b.v); }
VR_HD F16 operator/(F16 a, F16 b) { return _mm512_div_ps(a.v, b.v); }
VR_HD F16 operator-(F16 a) { return _mm512_xor_ps(a.v, _mm512_set1_ps(-0.f)); }
VR_HD M16 operator<(F16 a, F16 b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LT_OQ)}; }
VR_HD M16 operator<=(F16 a, F16 b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_LE_OQ)}; }
VR_HD M16 operator>(F16 a, F16 b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_GT_OQ)}; }
VR_HD M16 operator>=(F16 a, F16 b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_GE_OQ)}; }
VR_HD M16 operator==(F16 a, F16 b) { return {_mm512_cmp_ps_mask(a.v, b.v, _CMP_EQ_OQ)}; }
VR_HD U16 operator+(U16 a, U16 b) { return _mm512_add_epi32(a.v, b.v); }
VR_HD U16 operator-(U16 a, U16 b) { return {_mm512_sub_epi32(a.v, b.v)}; }
VR_HD U16 operator*(U16 a, U16 b) { return _mm512_mullo_epi32(a.v, b.v); }
VR_HD U16 operator&(U16 a, U16 b) { return _mm512_and_si512(a.v, b.v); }
VR_HD U16 operator|(U16 a, U16 b) { return _mm512_or_si512(a.v, b.v); }
VR_HD U16 operator^(U16 a, U16 b) { return _mm512_xor_si512(a.v, b.v); }
VR_HD U16 operator>>(U16 a, int n) { return _mm512_srli_epi32(a.v, static_cast<unsigned>(n)); }
VR_HD U16 operator<<(U16 a, int n) { return _mm512_slli_epi32(a.v, static_cast<unsigned>(n)); }
VR_HD M16 operator==(U16 a, U16 b) { return {_mm512_cmpeq_epi32_mask(a.v, b.v)}; }
VR_HD M16 operator<(U16 a, U16 b) { return {_mm512_cmplt_epu32_mask(a.v, b.v)}; }
VR_HD M16 operator&(M16 a, M16 b) { return {_kand_mask16(a.m, b.m)}; }
VR_HD M16 operator|(M16 a, M16 b) { return {_kor_mask16(a.m, b.m)}; }
VR_HD M16 operator!(M16 a) { return {_knot_mask16(a.m)}; }

VR_HD F16 fma(F16 a, F16 b, F16 c) { return _mm512_fmadd_ps(a.v, b.v, c.v); }
VR_HD F16 sqrt(F16 a) { return _mm512_sqrt_ps(a.v); }
VR_HD F16 abs(F16 a) { return _mm512_abs_ps(a.v); }
VR_HD F16 min(F16 a, F16 b) { return _mm512_min_ps(a.v, b.v); }
VR_HD F16 max(F16 a, F16 b) { return _mm512_max_ps(a.v, b.v); }
VR_HD F16 select(M16 m, F16 a, F16 b) { return _mm512_mask_blend_ps(m.m, b.v, a.v); }
VR_HD U16 select(M16 m, U16 a, U16 b) { return _mm512_mask_blend_epi32(m.m, b.v, a.v); }
VR_HD M16 and_less(M16 m, F16 a, F16 b) {
    return {_mm512_mask_cmp_ps_mask(m.m, a.v, b.v, _CMP_LT_OQ)};
}
VR_HD M16 both_within(F16 a, F16 b, F16 limit) {
    return {_mm512_mask_cmp_ps_mask((abs(a) <= limit).m, abs(b).v, limit.v, _CMP_LE_OQ)};
}
VR_HD bool any(M16 m) { return m.m != 0; }
VR_HD bool none(M16 m) { return m.m == 0; }
VR_HD uint32_t bits(M16 m) { return m.m; }
VR_HD uint32_t count(M16 m) { return static_cast<uint32_t>(__builtin_popcount(m.m)); }
VR_HD float least(F16 a) { return _mm512_reduce_min_ps(a.v); }
VR_HD float greatest(F16 a) { return _mm512_reduce_max_ps(a.v); }
VR_HD F16 to_float(U16 a) { return _mm512_cvtepi32_ps(a.v); }
VR_HD U16 to_uint(F16 a) { return _mm512_cvttps_epi32(a.v); }
VR_HD U16 as_uint(F16 a) { return _mm512_castps_si512(a.v); }
VR_HD F16 as_float(U16 a) { return _mm512_castsi512_ps(a.v); }
VR_HD F16 gather(const float* p, U16 i) { return _mm512_i32gather_ps(i.v, p, 4); }
VR_HD U16 gather(const uint32_t* p, U16 i) { return _mm512_i32gather_epi32(i.v, p, 4); }
// Whole rows are loaded and turned: four times as fast as gathering their columns (Zen 4).
VR_HD void gather4(const float* p, U16 i, F16 (&row)[4]) {
    uint32_t at[16];
    _mm512_storeu_si512(at, i.v);
    const auto rows = [&](uint32_t k) {  // of lanes k, k + 4, k + 8, k + 12
        const auto one = [&](uint32_t lane) { return _mm_loadu_ps(p + at[lane]); };
        __m512 v = _mm512_castps128_ps512(one(k));
        v = _mm512_insertf32x4(v, one(k + 4), 1);
        v = _mm512_insertf32x4(v, one(k + 8), 2);
        return _mm512_insertf32x4(v, one(k + 12), 3);
    };
    const __m512 a = rows(0), b = rows(1), c = rows(2), d = rows(3);
    const __m512d ab = _mm512_castps_pd(_mm512_unpacklo_ps(a, b)),
                  cd = _mm512_castps_pd(_mm512_unpacklo_ps(c, d)),
                  ab_high = _mm512_castps_pd(_mm512_unpackhi_ps(a, b)),
                  cd_high = _mm512_castps_pd(_mm512_unpackhi_ps(c, d));
    row[0] = _mm512_castpd_ps(_mm512_unpacklo_pd(ab, cd));
    row[1] = _mm512_castpd_ps(_mm512_unpackhi_pd(ab, cd));
    row[2] = _mm512_castpd_ps(_mm512_unpacklo_pd(ab_high, cd_high));
    row[3] = _mm512_castpd_ps(_mm512_unpackhi_pd(ab_high, cd_high));
}
VR_HD void gather3(const float* p, U16 i, F16 (&row)[3]) {
    F16 all[4];
    gather4(p, i, all);
    for (uint32_t k = 0; k < 3; ++k) row[k] = all[k];
}
VR_HD F16 lookup(const float* column, U16 i, uint32_t n) {
    if (n <= 32)
        return _mm512_permutex2var_ps(_mm512_loadu_ps(column), i.v, _mm512_loadu_ps(column + 16));
    return gather(column, i);
}
VR_HD F16 load(const float* p, F16) { return _mm512_loadu_ps(p); }
VR_HD U16 load(const uint32_t* p, U16) { return _mm512_loadu_si512(p); }
VR_HD void store(float* p, F16 a) { _mm512_storeu_ps(p, a.v); }
VR_HD void store(uint32_t* p, U16 a) { _mm512_storeu_si512(p, a.v); }
VR_HD M16 mask_of(uint32_t m, M16) { return {static_cast<__mmask16>(m)}; }
VR_HD M16 first_lanes(uint32_t n, M16) {
    return {static_cast<__mmask16>(n >= 16 ? 0xffffu : (1u << n) - 1u)};
}
VR_HD void compress_store(float* p, F16 a, M16 m) {
    _mm512_storeu_ps(p, _mm512_maskz_compress_ps(m.m, a.v));
}
VR_HD void compress_store(uint32_t* p, U16 a, M16 m) {
    _mm512_storeu_si512(p, _mm512_maskz_compress_epi32(m.m, a.v));
}
VR_HD D16 to_double(F16 a) {
    return {_mm512_cvtps_pd(_mm512_castps512_ps256(a.v)),
            _mm512_cvtps_pd(_mm512_extractf32x8_ps(a.v, 1))};
}
VR_HD D16 operator+(D16 a, D16 b) {
    return {_mm512_add_pd(a.low, b.low), _mm512_add_pd(a.high, b.high)};
}
VR_HD D16 operator-(D16 a, D16 b) {
    return {_mm512_sub_pd(a.low, b.low), _mm512_sub_pd(a.high, b.high)};
}
VR_HD D16 operator*(D16 a, D16 b) {
    return {_mm512_mul_pd(a.low, b.low), _mm512_mul_pd(a.high, b.high)};
}
VR_HD F16 floor(F16 a) {
    return _mm512_roundscale_ps(a.v, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
}
VR_HD D16 floor(D16 a) {
    constexpr int down = _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC;
    return {_mm512_roundscale_pd(a.low, down), _mm512_roundscale_pd(a.high, down)};
}
VR_HD void store(double* p, D16 a) {
    _mm512_storeu_pd(p, a.low);
    _mm512_storeu_pd(p + 8, a.high);
}

}  // namespace veriray
