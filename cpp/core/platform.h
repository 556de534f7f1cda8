// The only file that knows which compiler is in use.
#pragma once

#include <cstdint>
#include <cstring>

#if defined(__CUDACC__)
#define VR_CUDA 1
#else
#define VR_CUDA 0
#endif

#if VR_CUDA
#define VR_HD __host__ __device__ __forceinline__
#else
#define VR_HD inline __attribute__((always_inline))
#endif

// After a lambda's parameters: as VR_HD, which a lambda has from where it stands.
#if VR_CUDA
#define VR_INLINED
#else
#define VR_INLINED __attribute__((always_inline))
#endif

#if defined(__CUDA_ARCH__)
#define VR_DEVICE_CODE 1
#else
#define VR_DEVICE_CODE 0
#endif

// A function that few lanes need: always called, never inlined, so the caller's code does not pay
// for its registers.
#if VR_CUDA
#define VR_RARE __host__ __device__ __noinline__
#else
#define VR_RARE __attribute__((noinline, cold))
#endif

// A function that several callers share on a CPU.
#if VR_CUDA
#define VR_CALLED VR_HD
#else
#define VR_CALLED __attribute__((noinline))
#endif

// A long function that several callers share, compiled once; inlined in kernels made at run time,
// which are made for one scene.
#if defined(__CUDACC_RTC__)
#define VR_LONG VR_HD
#elif VR_CUDA
#define VR_LONG __host__ __device__ __noinline__
#else
#define VR_LONG __attribute__((noinline))
#endif

// A function of a few numbers with many callers, of which CUDA kernels have one copy
// (cpp/README.md, "Kernels stay within the instruction cache").
#if VR_CUDA
#define VR_ONCE __host__ __device__ __noinline__
#else
#define VR_ONCE VR_HD
#endif

// Before a loop that the device compiler must not unroll.
#if VR_CUDA
#define VR_ROLLED _Pragma("unroll 1")
#else
#define VR_ROLLED
#endif

namespace veriray {

// acc += value on integers shared between threads: the result does not depend on the order.
// Returns the value before the addition, so that a carry can be found.
VR_HD uint64_t atomic_add(uint64_t* acc, uint64_t value) {
#if VR_DEVICE_CODE
    return atomicAdd(reinterpret_cast<unsigned long long*>(acc),
                     static_cast<unsigned long long>(value));
#else
    return __atomic_fetch_add(acc, value, __ATOMIC_RELAXED);
#endif
}

// Reads a word that other threads may be writing.
VR_HD uint32_t atomic_load(const uint32_t* word) {
#if VR_DEVICE_CODE
    return *static_cast<const volatile uint32_t*>(word);
#else
    return __atomic_load_n(word, __ATOMIC_RELAXED);
#endif
}

#if VR_CUDA
// Raises the counter by the number of lanes in `together`, all of which call it; each lane gets a
// different value.
__device__ inline uint32_t raise_together(uint32_t together, uint32_t* counter) {
    const uint32_t lane = threadIdx.x & 31u;
    const int leader = __ffs(static_cast<int>(together)) - 1;
    uint32_t first = 0;
    if (lane == static_cast<uint32_t>(leader))
        first = atomicAdd(counter, static_cast<uint32_t>(__popc(together)));
    first = __shfl_sync(together, first, leader);
    return first + static_cast<uint32_t>(__popc(together & ((1u << lane) - 1u)));
}
#endif

// The counter's value before it is raised by one for this thread; a warp raises it once.
VR_HD uint32_t atomic_next(uint32_t* counter) {
#if VR_DEVICE_CODE
    return raise_together(__activemask(), counter);
#else
    return __atomic_fetch_add(counter, 1u, __ATOMIC_RELAXED);
#endif
}

// The same for counters[which], where `which` may differ between lanes.
VR_HD uint32_t atomic_next(uint32_t* counters, uint32_t which) {
#if VR_DEVICE_CODE
    return raise_together(__match_any_sync(__activemask(), which), counters + which);
#else
    return atomic_next(counters + which);
#endif
}

// Reconverges the lanes of a warp that a branch has separated. All lanes that have not exited must
// call it; a lane that waits at __syncthreads has not exited.
VR_HD void rejoin_warp() {
#if VR_DEVICE_CODE
    __syncwarp();
#endif
}

// The number of lanes of the warp for which the condition holds; all lanes that have not exited
// must call it.
VR_HD uint32_t lanes_with(bool x) {
#if VR_DEVICE_CODE
    return static_cast<uint32_t>(__popc(__ballot_sync(~0u, x)));
#else
    return x;
#endif
}

// Correctly rounded on either machine.
VR_HD float ieee_fma(float a, float b, float c) {
#if VR_DEVICE_CODE
    return __fmaf_rn(a, b, c);
#else
    return __builtin_fmaf(a, b, c);
#endif
}
// a / b, correctly rounded if |b|, |a| and |a / b| lie in [2^-100, 2^100], or if a = 0 and |b|
// does; otherwise the result is meaningless. It is the compiler's code for a division, without the
// branch for other operands.
VR_HD float plain_quotient(float a, float b) {
#if VR_DEVICE_CODE
    float r;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(r) : "f"(b));
    r = __fmaf_rn(r, __fmaf_rn(-b, r, 1.f), r);
    const float q = __fmul_rn(a, r);
    return __fmaf_rn(r, __fmaf_rn(-b, q, a), q);
#else
    return a / b;
#endif
}
VR_HD float magnitude(float a) {
#if VR_DEVICE_CODE
    return fabsf(a);
#else
    return __builtin_fabsf(a);
#endif
}
VR_HD float ieee_floor(float a) {
#if VR_DEVICE_CODE
    return floorf(a);
#else
    return __builtin_floorf(a);
#endif
}
VR_HD double ieee_floor(double a) {
#if VR_DEVICE_CODE
    return ::floor(a);
#else
    return __builtin_floor(a);
#endif
}
VR_HD float ieee_sqrt(float a) {
#if VR_DEVICE_CODE
    return __fsqrt_rn(a);
#else
    return __builtin_sqrtf(a);
#endif
}
VR_HD double ieee_sqrt(double a) {
#if VR_DEVICE_CODE
    return __dsqrt_rn(a);
#else
    return __builtin_sqrt(a);
#endif
}

// The upper word of a product, and the number of zeros above the first one, for a > 0.
VR_HD uint64_t upper_product(uint64_t a, uint64_t b) {
#if VR_DEVICE_CODE
    return __umul64hi(a, b);
#else
    return static_cast<uint64_t>(static_cast<unsigned __int128>(a) * b >> 64);
#endif
}
VR_HD int leading_zeros(uint64_t a) {
#if VR_DEVICE_CODE
    return __clzll(static_cast<long long>(a));
#else
    return __builtin_clzll(a);
#endif
}

template <class To, class From>
VR_HD To bit_cast(From from) {
    static_assert(sizeof(To) == sizeof(From));
    To to;
    memcpy(&to, &from, sizeof(to));
    return to;
}

}  // namespace veriray
