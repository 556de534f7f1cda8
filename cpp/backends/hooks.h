// Parts of the stages by name, for the test suite: the same list on every backend.
#pragma once

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <string>

#include "core/mapping.h"

namespace veriray {

inline constexpr const char* kMathNames[] = {"sin_2pi", "cos_2pi", "sqrt", "reciprocal", "tent"};
inline constexpr const char* kMappingNames[] = {"cosine_hemisphere", "uniform_sphere",
                                                "uniform_triangle"};

template <class F>
VR_HD F math_function(int which, F x) {
    F s, c;
    sincos_2pi(which < 2 ? x : F(0.f), s, c);
    return which == 0   ? s
           : which == 1 ? c
           : which == 2 ? sqrt(x)
           : which == 3 ? F(1.f) / x
                        : tent(x);
}

// The triangle's third coordinate is its first barycentric weight.
template <class F>
VR_HD Vec3<F> mapping_function(int which, F u, F v) {
    if (which == 0) return cosine_hemisphere(u, v);
    if (which == 1) return uniform_sphere(u, v);
    F b1, b2;
    uniform_triangle(u, v, b1, b2);
    return {b1, b2, F(1.f) - b1 - b2};
}

template <size_t n>
int find_name(const char* const (&names)[n], const std::string& name) {
    const auto at = std::find(std::begin(names), std::end(names), name);
    if (at == std::end(names)) throw std::invalid_argument("unknown function '" + name + "'");
    return static_cast<int>(at - std::begin(names));
}

}  // namespace veriray
