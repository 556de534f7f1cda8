// Random numbers as a pure function of (seed, pixel, sample, vertex, named dimension).
// No state, no clock, no order of execution.
#pragma once

#include "core/sobol.h"

namespace veriray {

template <class U>
struct Block {
    U x, y, z, w;
};

// Bijection of 128 bits, four words in, four words out.
// M. Jarzynski, M. Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020 (pcg4d).
template <class U>
VR_HD Block<U> hash(Block<U> v) {
    const U a(1664525u), c(1013904223u);
    v = {v.x * a + c, v.y * a + c, v.z * a + c, v.w * a + c};
    v.x = v.x + v.y * v.w;
    v.y = v.y + v.z * v.x;
    v.z = v.z + v.x * v.y;
    v.w = v.w + v.y * v.z;
    v = {v.x ^ (v.x >> 16), v.y ^ (v.y >> 16), v.z ^ (v.z >> 16), v.w ^ (v.w >> 16)};
    v.x = v.x + v.y * v.w;
    v.y = v.y + v.z * v.x;
    v.z = v.z + v.x * v.y;
    v.w = v.w + v.y * v.z;
    return v;
}

enum class Sampler : uint32_t { kIndependent, kSobol };

// 64 key bits from the seed and the upper half of the sample index; one key per launch.
struct RandomKey {
    uint32_t k0, k1;
    Sampler sampler;
};
VR_HD RandomKey random_key(uint64_t seed, uint32_t sample_high, Sampler sampler) {
    const Block<uint32_t> h = hash(Block<uint32_t>{
        static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32), sample_high, 0x76657269u});
    return {h.x, h.y, sampler};
}

// Named dimensions. A block is four numbers; a path uses block kCamera once, and up to three blocks
// per segment.
enum Dimension : uint32_t {
    kCamera = 0,   // film x, film y, lens u, lens v
    kScatter = 1,  // light u, light v, direction u, direction v
    kDecide = 2,   // light choice, roulette, lobe, free
    kCross = 3,    // free flight, its channel, opacity, blend
    kBlocksPerSegment = 3,
};
// subpath: of a sample with several, such as one from the camera and one from a light; the blocks
// of two subpaths differ for all depths.
inline constexpr uint32_t kSubpathBlocks = 1u << 24;
VR_HD uint32_t dimension_block(uint32_t segment, Dimension d, uint32_t subpath = 0) {
    return subpath * kSubpathBlocks + segment * kBlocksPerSegment + d;
}

// Vertices from the seventh on take independent numbers: they cause little of a picture's noise.
inline constexpr uint32_t kSobolBlocks = 6 * kBlocksPerSegment + 1;

// Four independent words; of Sobol's, their leading digits are those of groups of samples. Unused
// words cost nothing.
template <class U>
VR_HD Block<U> random_block(RandomKey key, U pixel, U sample, uint32_t block) {
    const U first = pixel + U(key.k0);
    Block<U> r = hash(Block<U>{first, sample, U(block), U(key.k1)});
    if (key.sampler == Sampler::kIndependent || block >= kSobolBlocks) return r;
    const Block<U> g = hash(Block<U>{first, sample >> kGroupDigits, U(block), U(~key.k1)});
    const U digits = group_digits(g.x, g.y, sample);
    const auto lead = [&](U word, U at_top) {
        constexpr uint32_t kTop = ~0u << (32 - kGroupDigits);
        return (word & U(~kTop)) | (at_top & U(kTop));
    };
    return {lead(r.x, digits << 24), lead(r.y, digits << 16), lead(r.z, digits << 8),
            lead(r.w, digits)};
}

// An unbounded run of blocks, for what takes a number of steps that is not known beforehand.
template <class U>
struct RandomStream {
    U a, b, step;
};
// Subpaths for streams of a segment: of its flight, of its light sample's shadow ray, and of the
// light's choice.
inline constexpr uint32_t kFlightSteps = 254, kShadowSteps = 255, kLightSteps = 253;
template <class U>
VR_HD RandomStream<U> random_stream(RandomKey key, U pixel, U sample, uint32_t block) {
    const Block<U> r = random_block({key.k0, key.k1, Sampler::kIndependent}, pixel, sample, block);
    return {r.x, r.y, U(0u)};
}
// The next block of the lanes of m.
template <class U, class M>
VR_HD Block<U> next_block(RandomStream<U>& s, M m) {
    const Block<U> r = hash(Block<U>{s.a, s.b, s.step, U(0x73746570u)});
    s.step = select(m, s.step + U(1u), s.step);
    return r;
}

// Uniform on the 2^24 multiples of 2^-24 in [0, 1): never 1.
template <class U>
VR_HD auto uniform(U u) {
    using F = decltype(to_float(u));
    return to_float(u >> 8) * F(0x1p-24f);
}

}  // namespace veriray
