// Lane types. Stage code is written once on a lane policy L with
//   L::F  float lanes     L::U  uint32 lanes     L::M  mask lanes     L::kWidth
//   L::D  double lanes, with sums, products and floor only
//   L::Uniform  a number that is equal in all lanes, for tables that loops run over
// There is Scalar (CUDA threads, CPU tests) and the widest vector that the translation unit is
// compiled for. compress_store(p, a, m) writes the lanes of m side by side from p on (up to
// kWidth entries from p may be overwritten); first_lanes(n) is the mask of the first n lanes and
// mask_of(bits) the inverse of bits(m). Every operation is IEEE-754 round-to-nearest, so all widths
// give the same bits.
#pragma once

#include "core/platform.h"

namespace veriray {

struct Scalar {
    using F = float;
    using D = double;
    using U = uint32_t;
    using M = bool;
    using Uniform = float;
    static constexpr uint32_t kWidth = 1;
};

// ---- scalar lane ----
VR_HD float fma(float a, float b, float c) { return ieee_fma(a, b, c); }
VR_HD float sqrt(float a) { return ieee_sqrt(a); }
VR_HD float abs(float a) { return magnitude(a); }
// min and max return b when the comparison is false, NaN included, as x86 does.
VR_HD float min(float a, float b) { return a < b ? a : b; }
VR_HD float max(float a, float b) { return a > b ? a : b; }
// Those of float alone would take counts too, and round them.
VR_HD uint32_t min(uint32_t a, uint32_t b) { return a < b ? a : b; }
VR_HD uint32_t max(uint32_t a, uint32_t b) { return a > b ? a : b; }
VR_HD uint64_t min(uint64_t a, uint64_t b) { return a < b ? a : b; }
VR_HD uint64_t max(uint64_t a, uint64_t b) { return a > b ? a : b; }
VR_HD float select(bool m, float a, float b) { return m ? a : b; }
VR_HD uint32_t select(bool m, uint32_t a, uint32_t b) { return m ? a : b; }
// m & (a < b), compared only where m is set.
VR_HD bool and_less(bool m, float a, float b) { return m & (a < b); }
// |a| and |b| <= limit; undefined if one is NaN and the other within.
VR_HD bool both_within(float a, float b, float limit) {
    return (abs(a) <= limit) & (abs(b) <= limit);
}
VR_HD bool any(bool m) { return m; }
VR_HD bool none(bool m) { return !m; }
VR_HD uint32_t bits(bool m) { return m ? 1u : 0u; }
VR_HD uint32_t count(bool m) { return m ? 1u : 0u; }
// Exact for u < 2^24.
VR_HD float to_float(uint32_t u) { return static_cast<float>(static_cast<int32_t>(u)); }
// Truncation; defined for 0 <= a < 2^31.
VR_HD uint32_t to_uint(float a) { return static_cast<uint32_t>(static_cast<int32_t>(a)); }
VR_HD uint32_t as_uint(float a) { return bit_cast<uint32_t>(a); }
VR_HD float as_float(uint32_t a) { return bit_cast<float>(a); }
VR_HD double to_double(float a) { return static_cast<double>(a); }
VR_HD float floor(float a) { return ieee_floor(a); }
VR_HD double floor(double a) { return ieee_floor(a); }
VR_HD float gather(const float* p, uint32_t i) { return p[i]; }
VR_HD uint32_t gather(const uint32_t* p, uint32_t i) { return p[i]; }
VR_HD float load(const float* p, float) { return *p; }
VR_HD uint32_t load(const uint32_t* p, uint32_t) { return *p; }
VR_HD void store(float* p, float a) { *p = a; }
VR_HD void store(uint32_t* p, uint32_t a) { *p = a; }
VR_HD void store(double* p, double a) { *p = a; }
VR_HD bool mask_of(uint32_t m, bool) { return m & 1u; }
// gather from a column padded to at least 32 entries; n entries are in use.
VR_HD float lookup(const float* column, uint32_t i, uint32_t) { return column[i]; }

// Aligned vectors from memory that nobody writes at the same time.
template <class T>
struct alignas(2 * sizeof(T)) Pair {
    T x, y;
};
template <class T>
struct alignas(4 * sizeof(T)) Quad {
    T x, y, z, w;
};
VR_HD Pair<float> load2(const float* p) {
#if VR_DEVICE_CODE
    const float2 a = __ldg(reinterpret_cast<const float2*>(p));
    return {a.x, a.y};
#else
    return {p[0], p[1]};
#endif
}
VR_HD Quad<float> load4(const float* p) {
#if VR_DEVICE_CODE
    const float4 a = __ldg(reinterpret_cast<const float4*>(p));
    return {a.x, a.y, a.z, a.w};
#else
    return {p[0], p[1], p[2], p[3]};
#endif
}
// The numbers p[i] to p[i + 3] of a row; p and i are multiples of four numbers.
VR_HD void gather4(const float* p, uint32_t i, float (&row)[4]) {
    const Quad<float> a = load4(p + i);
    row[0] = a.x, row[1] = a.y, row[2] = a.z, row[3] = a.w;
}
// Of any place; one more number must be there.
VR_HD void gather3(const float* p, uint32_t i, float (&row)[3]) {
    for (uint32_t k = 0; k < 3; ++k) row[k] = p[i + k];
}

}  // namespace veriray

#if VR_CUDA
// Device code is scalar; the vector lanes belong to the CPU translation units.
#elif defined(__AVX512F__) && defined(__AVX512DQ__) && defined(__AVX512VL__)
#include "core/lane_avx512.h"
#elif defined(__AVX2__) && defined(__FMA__)
#include "core/lane_avx2.h"
#else
#define VR_ONE_LANE 1  // Simd is Scalar
#include "core/lane_scalar.h"
#endif
