// Error-free transformations: numbers as unevaluated sums of two floats.
// D. Knuth, The Art of Computer Programming 2, 4.2.2; T. Ogita, S. Rump, S. Oishi, "Accurate Sum
// and Dot Product", SIAM J. Sci. Comput. 26(6), 2005.
#pragma once

#include "core/vec.h"

namespace veriray {

template <class F>
struct Two {
    F hi, lo;
};

// a + b = hi + lo exactly, hi = a + b rounded.
template <class F>
VR_HD Two<F> two_sum(F a, F b) {
    const F sum = a + b;
    const F b_part = sum - a;
    return {sum, (a - (sum - b_part)) + (b - b_part)};
}

// a b = hi + lo exactly (short of underflow), hi = a b rounded.
template <class F>
VR_HD Two<F> two_product(F a, F b) {
    const F product = a * b;
    return {product, fma(a, b, -product)};
}

// sum + a b to about 2^-47 of the largest term.
template <class F>
VR_HD Two<F> add_product(Two<F> sum, F a, F b) {
    const Two<F> product = two_product(a, b), total = two_sum(sum.hi, product.hi);
    return {total.hi, sum.lo + (product.lo + total.lo)};
}

// A vector hi + lo; |lo| <= 2^-24 |hi| in each component.
template <class F>
struct TwoVec3 {
    Vec3<F> hi, lo;
};

// a.b + start to about 2^-46 of the largest term.
template <class F>
VR_HD Two<F> add_dot(Two<F> start, const TwoVec3<F>& a, Vec3<F> b) {
    Two<F> sum = add_product(start, a.hi.x, b.x);
    sum = add_product(sum, a.hi.y, b.y);
    sum = add_product(sum, a.hi.z, b.z);
    return {sum.hi, sum.lo + dot(a.lo, b)};
}

// a + b t.
template <class F>
VR_HD TwoVec3<F> fma(Vec3<F> b, F t, const TwoVec3<F>& a) {
    const auto component = [&](F hi, F lo, F factor) {
        const Two<F> sum = add_product(Two<F>{hi, lo}, factor, t);
        return two_sum(sum.hi, sum.lo);
    };
    const Two<F> x = component(a.hi.x, a.lo.x, b.x), y = component(a.hi.y, a.lo.y, b.y),
                 z = component(a.hi.z, a.lo.z, b.z);
    return {{x.hi, y.hi, z.hi}, {x.lo, y.lo, z.lo}};
}

}  // namespace veriray
