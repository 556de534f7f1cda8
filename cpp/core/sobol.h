// Padded Owen-scrambled Sobol points: every pair of dimensions is its own (0,2)-sequence in base 2,
// in a shuffled order, so pairs are independent of each other. Any 2^m samples that start at a
// multiple of 2^m have one point in each of the 2^m cells of every dyadic partition of the square.
//
// B. Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020; A. Owen, "Scrambled Net
// Variance for Integrals of Smooth Functions", 1997.
#pragma once

#include "core/lane.h"

namespace veriray {

// A bijection in which each bit depends only on the seed and on lower bits: Owen's scrambling of
// words with reversed bits. S. Laine, T. Karras, "Stratified Sampling for Stochastic Transparency",
// 2011; the constants are N. Vegdahl's (2021).
template <class U>
VR_HD U scramble_reversed(U x, U seed) {
    x = x ^ x * U(0x3d20adeau);
    x = x + seed;
    x = x * ((seed >> 16) | U(1u));
    x = x ^ x * U(0x05526c56u);
    return x ^ x * U(0x53a22864u);
}

// The second dimension from the index, with bits reversed: its generator is the Pascal matrix
// modulo 2, which maps the polynomial i(x) to i(x + 1).
template <class U>
VR_HD U second_dimension_reversed(U i) {
    i = i ^ (i >> 16);
    i = i ^ ((i & U(0xff00ff00u)) >> 8);
    i = i ^ ((i & U(0xf0f0f0f0u)) >> 4);
    i = i ^ ((i & U(0xccccccccu)) >> 2);
    return i ^ ((i & U(0xaaaaaaaau)) >> 1);
}

// The pair (x, y) of a sample in units of 2^-32. Pairs may share seed_x and seed_y: different
// orders suffice to make them independent.
template <class U>
VR_HD void sobol_pair(U sample, U seed_order, U seed_x, U seed_y, U& x, U& y) {
    const U i = reverse_bits(scramble_reversed(reverse_bits(sample), seed_order));
    x = reverse_bits(scramble_reversed(i, seed_x));
    y = reverse_bits(scramble_reversed(second_dimension_reversed(i), seed_y));
}

}  // namespace veriray
