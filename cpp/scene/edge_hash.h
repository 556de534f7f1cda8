// Whether surfaces are closed, by sums of hashes over their edges.
#pragma once

#include "scene/scene.h"

namespace veriray {

// A bijection that scatters bits: G. Steele, D. Lea, C. Flood, "Fast Splittable Pseudorandom Number
// Generators", OOPSLA 2014 (variant 13 of MurmurHash3's finisher).
inline uint64_t mixed(uint64_t x) {
    x = (x ^ x >> 30) * 0xbf58476d1ce4e5b9u;
    x = (x ^ x >> 27) * 0x94d049bb133111ebu;
    return x ^ x >> 31;
}
inline uint64_t hashed(Double3 p) {
    uint64_t h = 0;
    for (int k = 0; k < 3; ++k) h = mixed(h + bit_cast<uint32_t>(static_cast<float>(p[k]) + 0.f));
    return h;
}
// Of opposite sign for a -> b and b -> a: the sum over all edges is 0 if a surface is closed and
// consistently wound, and otherwise with a probability of 2^-64.
inline uint64_t edge(uint64_t a, uint64_t b) { return mixed(a + 3 * b) - mixed(b + 3 * a); }
// Of a triangle.
inline uint64_t edges(const Flat& f) {
    const uint64_t h[3] = {hashed(f.v[0]), hashed(f.v[1]), hashed(f.v[2])};
    return edge(h[0], h[1]) + edge(h[1], h[2]) + edge(h[2], h[0]);
}

}  // namespace veriray
