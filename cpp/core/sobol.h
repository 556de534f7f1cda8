// Leading digits of four numbers in [0, 1) over a group of 16 samples: two pairs, each the first 16
// points of Sobol's sequence, shifted and in an order of its own. So a pair has one sample of a
// group in each of the 16 cells of every dyadic partition of the square; the aligned runs of 2, 4
// and 8 samples likewise.
//
// The order is by a random linear map over bits that is triangular, as A. Owen's scrambling is
// nested ("Randomly Permuted (t,m,s)-Nets", 1995), with the same joint laws of two samples; the
// shift is a digital one. J. Matousek, "On the L2-Discrepancy for Anchored Boxes", 1998, section 6.
#pragma once

#include "core/lane.h"

namespace veriray {

// The samples of a group, and the binary digits of each number that it settles.
inline constexpr uint32_t kGroupSamples = 16, kGroupDigits = 4;

// order, shift: random words, the same for all samples of a group, of which the last four bits are
// not used: those of a hash are its weakest. Byte k of the result, in its upper half, has the
// digits of number k, the first one highest.
template <class U>
VR_HD U group_digits(U order, U shift, U sample) {
    const auto all_if = [](U bit) { return U(0u) - (bit & U(1u)); };
    // The place in each pair's sequence, with bits reversed, in bytes 0 and 2: bits of the sample
    // from the last to the first, each of which changes those before it at random.
    U x = order & U(0x00f000f0u);
    x = x ^ (all_if(sample) & U(0x00800080u));
    x = x ^ (all_if(sample >> 1) & (U(0x00400040u) | (order >> 8 & U(0x00800080u))));
    x = x ^ (all_if(sample >> 2) & (U(0x00200020u) | (order >> 6 & U(0x00c000c0u))));
    x = x ^ (all_if(sample >> 3) & (U(0x00100010u) | (order >> 3 & U(0x00e000e0u))));
    // These are the first dimension's digits. The second one's generator is the Pascal matrix
    // modulo 2, which maps the polynomial i(t) to i(t + 1).
    U y = x ^ (x & U(0x00300030u)) << 2;
    y = y ^ (y & U(0x00500050u)) << 1;
    return (x | y << 8) ^ (shift & U(0xf0f0f0f0u));
}

}  // namespace veriray
