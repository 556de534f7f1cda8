// Eight lanes on AVX2 and FMA (x86-64-v3). A mask is all ones or all zeros per lane.
#pragma once

#include <immintrin.h>

namespace veriray {

struct M8 {
    __m256 m;
};
struct U8 {
    __m256i v;
    U8() = default;
    VR_HD U8(__m256i a) : v(a) {}
    VR_HD U8(uint32_t a) : v(_mm256_set1_epi32(static_cast<int>(a))) {}
};
struct F8 {
    __m256 v;
    F8() = default;
    VR_HD F8(__m256 a) : v(a) {}
    VR_HD F8(float a) : v(_mm256_set1_ps(a)) {}
};

struct D8 {
    __m256d low, high;
    D8(__m256d a, __m256d b) : low(a), high(b) {}
    VR_HD D8(double a) : low(_mm256_set1_pd(a)), high(low) {}
};

struct Simd {
    using F = F8;
    using D = D8;
    using U = U8;
    using M = M8;
    using Uniform = F8;  // an operand in memory; a float would need an instruction to broadcast it
    static constexpr uint32_t kWidth = 8;
};

VR_HD F8 operator+(F8 a, F8 b) { return _mm256_add_ps(a.v, b.v); }
VR_HD F8 operator-(F8 a, F8 b) { return _mm256_sub_ps(a.v, b.v); }
VR_HD F8 operator*(F8 a, F8 b) { return _mm256_mul_ps(a.v, b.v); }
VR_HD F8 operator/(F8 a, F8 b) { return _mm256_div_ps(a.v, b.v); }
VR_HD F8 operator-(F8 a) { return _mm256_xor_ps(a.v, _mm256_set1_ps(-0.f)); }
VR_HD M8 operator<(F8 a, F8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_LT_OQ)}; }
VR_HD M8 operator<=(F8 a, F8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_LE_OQ)}; }
VR_HD M8 operator>(F8 a, F8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_GT_OQ)}; }
VR_HD M8 operator>=(F8 a, F8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_GE_OQ)}; }
VR_HD M8 operator==(F8 a, F8 b) { return {_mm256_cmp_ps(a.v, b.v, _CMP_EQ_OQ)}; }
VR_HD U8 operator+(U8 a, U8 b) { return _mm256_add_epi32(a.v, b.v); }
VR_HD U8 operator-(U8 a, U8 b) { return {_mm256_sub_epi32(a.v, b.v)}; }
VR_HD U8 operator*(U8 a, U8 b) { return _mm256_mullo_epi32(a.v, b.v); }
VR_HD U8 operator&(U8 a, U8 b) { return _mm256_and_si256(a.v, b.v); }
VR_HD U8 operator|(U8 a, U8 b) { return _mm256_or_si256(a.v, b.v); }
VR_HD U8 operator^(U8 a, U8 b) { return _mm256_xor_si256(a.v, b.v); }
VR_HD U8 operator>>(U8 a, int n) { return _mm256_srli_epi32(a.v, n); }
VR_HD U8 operator<<(U8 a, int n) { return _mm256_slli_epi32(a.v, n); }
VR_HD M8 operator==(U8 a, U8 b) { return {_mm256_castsi256_ps(_mm256_cmpeq_epi32(a.v, b.v))}; }
VR_HD M8 operator<(U8 a, U8 b) {
    const __m256i top = _mm256_set1_epi32(static_cast<int>(0x80000000u));
    return {_mm256_castsi256_ps(
        _mm256_cmpgt_epi32(_mm256_xor_si256(b.v, top), _mm256_xor_si256(a.v, top)))};
}
VR_HD M8 operator&(M8 a, M8 b) { return {_mm256_and_ps(a.m, b.m)}; }
VR_HD M8 operator|(M8 a, M8 b) { return {_mm256_or_ps(a.m, b.m)}; }
VR_HD M8 operator!(M8 a) {
    return {_mm256_xor_ps(a.m, _mm256_castsi256_ps(_mm256_set1_epi32(-1)))};
}

VR_HD F8 fma(F8 a, F8 b, F8 c) { return _mm256_fmadd_ps(a.v, b.v, c.v); }
VR_HD F8 sqrt(F8 a) { return _mm256_sqrt_ps(a.v); }
VR_HD F8 abs(F8 a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.f), a.v); }
VR_HD F8 min(F8 a, F8 b) { return _mm256_min_ps(a.v, b.v); }
VR_HD F8 max(F8 a, F8 b) { return _mm256_max_ps(a.v, b.v); }
VR_HD F8 select(M8 m, F8 a, F8 b) { return _mm256_blendv_ps(b.v, a.v, m.m); }
VR_HD U8 select(M8 m, U8 a, U8 b) {
    return _mm256_castps_si256(
        _mm256_blendv_ps(_mm256_castsi256_ps(b.v), _mm256_castsi256_ps(a.v), m.m));
}
VR_HD M8 and_less(M8 m, F8 a, F8 b) { return m & (a < b); }
VR_HD M8 both_within(F8 a, F8 b, F8 limit) { return max(abs(a), abs(b)) <= limit; }
VR_HD uint32_t bits(M8 m) { return static_cast<uint32_t>(_mm256_movemask_ps(m.m)); }
VR_HD bool any(M8 m) { return bits(m) != 0; }
VR_HD bool none(M8 m) { return bits(m) == 0; }
VR_HD uint32_t count(M8 m) { return static_cast<uint32_t>(__builtin_popcount(bits(m))); }
VR_HD float least(F8 a) {
    __m128 m = _mm_min_ps(_mm256_castps256_ps128(a.v), _mm256_extractf128_ps(a.v, 1));
    m = _mm_min_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_min_ss(m, _mm_shuffle_ps(m, m, 1)));
}
VR_HD float greatest(F8 a) { return -least(-a); }
VR_HD F8 to_float(U8 a) { return _mm256_cvtepi32_ps(a.v); }
VR_HD U8 to_uint(F8 a) { return _mm256_cvttps_epi32(a.v); }
VR_HD U8 as_uint(F8 a) { return _mm256_castps_si256(a.v); }
VR_HD F8 as_float(U8 a) { return _mm256_castsi256_ps(a.v); }
VR_HD F8 gather(const float* p, U8 i) { return _mm256_i32gather_ps(p, i.v, 4); }
VR_HD U8 gather(const uint32_t* p, U8 i) {
    return _mm256_i32gather_epi32(reinterpret_cast<const int*>(p), i.v, 4);
}
// Whole rows are loaded and turned: faster than gathering their columns.
VR_HD void gather4(const float* p, U8 i, F8 (&row)[4]) {
    uint32_t at[8];
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(at), i.v);
    const auto rows = [&](uint32_t k) {  // of lanes k and k + 4
        return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(p + at[k])),
                                    _mm_loadu_ps(p + at[k + 4]), 1);
    };
    const __m256 a = rows(0), b = rows(1), c = rows(2), d = rows(3);
    const __m256d ab = _mm256_castps_pd(_mm256_unpacklo_ps(a, b)),
                  cd = _mm256_castps_pd(_mm256_unpacklo_ps(c, d)),
                  ab_high = _mm256_castps_pd(_mm256_unpackhi_ps(a, b)),
                  cd_high = _mm256_castps_pd(_mm256_unpackhi_ps(c, d));
    row[0] = _mm256_castpd_ps(_mm256_unpacklo_pd(ab, cd));
    row[1] = _mm256_castpd_ps(_mm256_unpackhi_pd(ab, cd));
    row[2] = _mm256_castpd_ps(_mm256_unpacklo_pd(ab_high, cd_high));
    row[3] = _mm256_castpd_ps(_mm256_unpackhi_pd(ab_high, cd_high));
}
VR_HD void gather3(const float* p, U8 i, F8 (&row)[3]) {
    F8 all[4];
    gather4(p, i, all);
    for (uint32_t k = 0; k < 3; ++k) row[k] = all[k];
}
// Permutations select by the index's low three bits, blends by the fourth and fifth.
VR_HD F8 lookup(const float* column, U8 i, uint32_t n) {
    const auto of_eight = [&](uint32_t k) {
        return _mm256_permutevar8x32_ps(_mm256_loadu_ps(column + k), i.v);
    };
    if (n <= 8) return of_eight(0);
    if (n > 32) return gather(column, i);
    const __m256 fourth = _mm256_castsi256_ps(_mm256_slli_epi32(i.v, 28));
    const __m256 low = _mm256_blendv_ps(of_eight(0), of_eight(8), fourth);
    if (n <= 16) return low;
    const __m256 high = _mm256_blendv_ps(of_eight(16), of_eight(24), fourth);
    return _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32(i.v, 27)));
}
VR_HD F8 load(const float* p, F8) { return _mm256_loadu_ps(p); }
VR_HD U8 load(const uint32_t* p, U8) {
    return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(p));
}
VR_HD void store(float* p, F8 a) { _mm256_storeu_ps(p, a.v); }
VR_HD void store(uint32_t* p, U8 a) { _mm256_storeu_si256(reinterpret_cast<__m256i*>(p), a.v); }
VR_HD M8 first_lanes(uint32_t n, M8) {
    return U8(_mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7)) < U8(n);
}
VR_HD M8 mask_of(uint32_t m, M8) {
    const U8 bit(_mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128));
    return (U8(m) & bit) == bit;
}
// The index of the k-th set bit of m, for each lane k: surviving lanes keep their order.
VR_HD __m256i compress_order(uint32_t m) {
    const uint64_t spread = _pdep_u64(m, 0x0101010101010101ull) * 0xffull;
    const uint64_t order = _pext_u64(0x0706050403020100ull, spread);
    return _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(static_cast<long long>(order)));
}
VR_HD void compress_store(float* p, F8 a, M8 m) {
    _mm256_storeu_ps(p, _mm256_permutevar8x32_ps(a.v, compress_order(bits(m))));
}
VR_HD void compress_store(uint32_t* p, U8 a, M8 m) {
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(p),
                        _mm256_permutevar8x32_epi32(a.v, compress_order(bits(m))));
}

VR_HD D8 to_double(F8 a) {
    return {_mm256_cvtps_pd(_mm256_castps256_ps128(a.v)),
            _mm256_cvtps_pd(_mm256_extractf128_ps(a.v, 1))};
}
VR_HD D8 operator+(D8 a, D8 b) {
    return {_mm256_add_pd(a.low, b.low), _mm256_add_pd(a.high, b.high)};
}
VR_HD D8 operator-(D8 a, D8 b) {
    return {_mm256_sub_pd(a.low, b.low), _mm256_sub_pd(a.high, b.high)};
}
VR_HD D8 operator*(D8 a, D8 b) {
    return {_mm256_mul_pd(a.low, b.low), _mm256_mul_pd(a.high, b.high)};
}
VR_HD F8 floor(F8 a) { return _mm256_floor_ps(a.v); }
VR_HD D8 floor(D8 a) { return {_mm256_floor_pd(a.low), _mm256_floor_pd(a.high)}; }
VR_HD void store(double* p, D8 a) {
    _mm256_storeu_pd(p, a.low);
    _mm256_storeu_pd(p + 4, a.high);
}

}  // namespace veriray
