// Parts of the stages by name, for the test suite: the same list on every backend. A function takes
// and gives rows of float32.
#pragma once

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <string>

#include "core/mapping.h"
#include "lights/sphere_light.h"

namespace veriray {

struct FunctionInfo {
    const char* name;
    uint32_t inputs, outputs;  // columns
};

inline constexpr uint32_t kMaxColumns = 16;

enum class Function : uint32_t {
    kSin2Pi,
    kCos2Pi,
    kSqrt,
    kReciprocal,
    kTent,
    kLog,
    kExpMinus,
    kAcos,
    kExponential,        // upper and lower 16 bits of the word
    kTwoSum,             // a, b -> high, low
    kTwoProduct,         // a, b -> high, low
    kCosineHemisphere,   // u, v -> direction
    kUniformSphere,      // u, v -> direction
    kUniformTriangle,    // u, v -> barycentric weights of the 2nd, 3rd and 1st vertex
    kUniformDisk,        // u, v -> x, y
    kUniformCone,        // u, v, 1 - cos -> direction, pdf
    kOrthonormalFrame,   // n -> a, b
    kHenyeyGreenstein,   // d, g, u, v -> direction, pdf
    kHenyeyGreensteinP,  // d, w, g -> pdf
    kSphere,             // record, o, d, t_max -> t (infinite: missed), p, n, offset
    kSphereLight,        // record, p, u, v -> wi, pdf, distance, cos_light, pdf again
};

inline constexpr FunctionInfo kFunctions[] = {
    {"sin_2pi", 1, 1},
    {"cos_2pi", 1, 1},
    {"sqrt", 1, 1},
    {"reciprocal", 1, 1},
    {"tent", 1, 1},
    {"log", 1, 1},
    {"exp_minus", 1, 1},
    {"acos", 1, 1},
    {"exponential", 2, 1},
    {"two_sum", 2, 2},
    {"two_product", 2, 2},
    {"cosine_hemisphere", 2, 3},
    {"uniform_sphere", 2, 3},
    {"uniform_triangle", 2, 3},
    {"uniform_disk", 2, 2},
    {"uniform_cone", 3, 4},
    {"orthonormal_frame", 3, 6},
    {"henyey_greenstein", 6, 4},
    {"henyey_greenstein_pdf", 7, 1},
    {"sphere", 15, 8},
    {"sphere_light", 13, 7},
};

// The index in kFunctions, with which `evaluate` is called.
inline uint32_t find_function(const std::string& name) {
    const auto at = std::find_if(std::begin(kFunctions), std::end(kFunctions),
                                 [&](const FunctionInfo& f) { return name == f.name; });
    if (at == std::end(kFunctions)) throw std::invalid_argument("unknown function '" + name + "'");
    return static_cast<uint32_t>(at - std::begin(kFunctions));
}

template <class F>
VR_HD void put(F* y, Vec3<F> v) {
    y[0] = v.x, y[1] = v.y, y[2] = v.z;
}

template <class F>
VR_HD F evaluate_elementary(Function which, F x) {
    F s, c;
    switch (which) {
        case Function::kSin2Pi:
            return sincos_2pi(x, s, c), s;
        case Function::kCos2Pi:
            return sincos_2pi(x, s, c), c;
        case Function::kSqrt:
            return sqrt(x);
        case Function::kReciprocal:
            return F(1.f) / x;
        case Function::kTent:
            return tent(x);
        case Function::kLog:
            return log(x);
        case Function::kExpMinus:
            return exp_minus(x);
        default:
            return acos(x);
    }
}

template <class F>
VR_HD void evaluate_mapping(Function which, const F* x, F* y) {
    const F u = x[0], v = x[1];
    switch (which) {
        case Function::kExponential:
            y[0] = exponential((to_uint(u) << 16) | to_uint(v));
            break;
        case Function::kTwoSum: {
            const Two<F> s = two_sum(u, v);
            y[0] = s.hi, y[1] = s.lo;
            break;
        }
        case Function::kTwoProduct: {
            const Two<F> p = two_product(u, v);
            y[0] = p.hi, y[1] = p.lo;
            break;
        }
        case Function::kCosineHemisphere:
            put(y, cosine_hemisphere(u, v));
            break;
        case Function::kUniformSphere:
            put(y, uniform_sphere(u, v));
            break;
        case Function::kUniformTriangle:
            uniform_triangle(u, v, y[0], y[1]);
            y[2] = F(1.f) - y[0] - y[1];
            break;
        case Function::kUniformDisk:
            uniform_disk(u, v, y[0], y[1]);
            break;
        case Function::kUniformCone:
            put(y, uniform_cone(u, v, x[2]));
            y[3] = uniform_cone_pdf_sa(x[2]);
            break;
        case Function::kOrthonormalFrame: {
            Vec3<F> a, b;
            orthonormal_frame(Vec3<F>{x[0], x[1], x[2]}, a, b);
            put(y, a), put(y + 3, b);
            break;
        }
        case Function::kHenyeyGreenstein: {
            const Vec3<F> d{x[0], x[1], x[2]}, wi = henyey_greenstein(d, x[3], x[4], x[5]);
            put(y, wi);
            y[3] = henyey_greenstein_pdf(d, wi, x[3]);
            break;
        }
        default:
            y[0] = henyey_greenstein_pdf({x[0], x[1], x[2]}, {x[3], x[4], x[5]}, x[6]);
    }
}

template <class L>
VR_HD void evaluate_sphere(const typename L::F* x, typename L::F* y) {
    using F = typename L::F;
    const Ray<L> ray{{x[8], x[9], x[10]}, {x[11], x[12], x[13]}};
    F t;
    const auto met = meets_sphere<L>(x, ray, x[14], t);
    const SpherePoint<F> s = sphere_point(x, ray.o, ray.d, select(met, t, F(0.f)));
    y[0] = select(met, t, F(kInfinity));
    put(y + 1, s.p), put(y + 4, s.n);
    y[7] = s.offset;
}

// x: kFunctions[which].inputs lanes; y: outputs.
template <class L>
VR_HD void evaluate(uint32_t which, const typename L::F* x, typename L::F* y) {
    using F = typename L::F;
    const Function f = static_cast<Function>(which);
    if (f <= Function::kAcos) {
        y[0] = evaluate_elementary(f, x[0]);
    } else if (f <= Function::kHenyeyGreensteinP) {
        evaluate_mapping(f, x, y);
    } else if (f == Function::kSphere) {
        evaluate_sphere<L>(x, y);
    } else {
        const Vec3<F> p{x[8], x[9], x[10]};
        const SphereLightSample<F> s = sample_sphere_light(x, p, x[11], x[12]);
        put(y, s.wi);
        y[3] = s.pdf_sa, y[4] = s.distance, y[5] = s.cos_light;
        y[6] = sphere_light_pdf(x, p);
    }
}

}  // namespace veriray
