// Parts of the stages by name, for the test suite: the same list on every backend. A function takes
// and gives rows of float32.
#pragma once

#include <algorithm>
#include <iterator>
#include <stdexcept>
#include <string>

#include "backends/bsdf_hooks.h"
#include "backends/hook_lights.h"
#include "film/lane_sums.h"
#include "media/medium.h"

namespace veriray {

struct FunctionInfo {
    const char* name;
    uint32_t inputs, outputs;  // columns
};

inline constexpr uint32_t kMaxColumns = kBsdfInputs + 3;

enum class Function : uint32_t {
    kSin2Pi,
    kCos2Pi,
    kSqrt,
    kReciprocal,
    kTent,
    kLog,
    kExpMinus,
    kScaledBessel,
    kExponential,        // upper and lower 16 bits of the word
    kTwoSum,             // a, b -> high, low
    kTwoProduct,         // a, b -> high, low
    kPlainQuotient,      // a, b -> a / b
    kAngle,              // x, y -> the angle
    kCosineHemisphere,   // u, v -> direction
    kUniformTriangle,    // u, v -> barycentric weights of the 2nd, 3rd and 1st vertex
    kUniformDisk,        // u, v -> x, y
    kUniformCone,        // u, v, 1 - cos -> direction, pdf
    kOrthonormalFrame,   // n -> a, b
    kHenyeyGreenstein,   // d, g, u, v -> direction, pdf
    kHenyeyGreensteinP,  // d, w, g -> pdf
    kRayleigh,           // d, u, v -> direction, pdf
    kFlakes,             // d, w, u, v, a lobe's flakes -> direction, pdf; pdf of w, area along d
    kSphere,             // record, o, d, t_max -> t (infinite: missed), p, n, offset
    kConeOfSphere,       // record, p, u, v -> wi, pdf, distance, cos_light, pdf again
    kFresnelDielectric,  // cos_i, eta -> reflected, cos_t
    kFresnelConductor,   // cos_i, eta, k -> reflected
    kBsdfSample,         // material, n, wo, u, v, lobe
                         //   -> wi, weight, pdf, transmitted, pass, mirror, weight of importance
    kBsdfRadiance,       // the same without the weight of importance
    kBsdfEval,           // material, n, wo, wi
                         //   -> f cos, pdf, share that passes straight through, reverse pdf, albedo
    kLight,              // shape, p, e1, e2, n, offset, chance, receiver, u, v
                         //   -> wi, pdf, distance, radiance for 1, delta
    kLightPdf,           // shape, p, e1, e2, n, chance, receiver, wi
                         //   -> pdf if a ray along wi meets the light
    kLightEmission,      // shape, p, e1, e2, n, offset, chance, u, v, s, t
                         //   -> p, d, cosine, radiance for 1, pdf_area, pdf_sa
    kLightPower,         // shape, area, strength, cutoff, beam -> flux
    kFreeFlight,         // sigma, limit, upper and lower 16 bits -> t, collides
    kFreeFlightColour,   // sigma, albedo, throughput: 3 each; limit, u24, bits -> t, weight
    kFilmSums,  // x, y -> the film's sum and square of x and 63 times y, 16 bits a column from 2^0
    kFilmAccepts,  // sample of a film of scale 1/4 -> accepted, and where it may be negative
};

inline constexpr FunctionInfo kFunctions[] = {
    {"sin_2pi", 1, 1},
    {"cos_2pi", 1, 1},
    {"sqrt", 1, 1},
    {"reciprocal", 1, 1},
    {"tent", 1, 1},
    {"log", 1, 1},
    {"exp_minus", 1, 1},
    {"scaled_bessel", 1, 1},
    {"exponential", 2, 1},
    {"two_sum", 2, 2},
    {"two_product", 2, 2},
    {"plain_quotient", 2, 1},
    {"angle", 2, 1},
    {"cosine_hemisphere", 2, 3},
    {"uniform_triangle", 2, 3},
    {"uniform_disk", 2, 2},
    {"uniform_cone", 3, 4},
    {"orthonormal_frame", 3, 6},
    {"henyey_greenstein", 6, 4},
    {"henyey_greenstein_pdf", 7, 1},
    {"rayleigh", 5, 4},
    {"flakes", 8 + kFlakeFloats, 6},
    {"sphere", 15, 8},
    {"sphere_light", 13, 7},
    {"fresnel_dielectric", 2, 2},
    {"fresnel_conductor", 3, 1},
    {"bsdf_sample", kBsdfInputs + 3, 9},
    {"bsdf_sample_radiance", kBsdfInputs + 3, 8},
    {"bsdf_eval", kBsdfInputs + 3, 5},
    {"light", 20, 7},
    {"light_pdf", 20, 1},
    {"light_emission", 19, 10},
    {"light_power", 5, 1},
    {"free_flight", 4, 2},
    {"free_flight_colour", 13, 4},
    {"film_sums", 2, 16},
    {"film_accepts", 3, 2},
};

// The index in kFunctions, with which `evaluate` is called.
inline uint32_t find_function(const std::string& name) {
    const auto at = std::find_if(std::begin(kFunctions), std::end(kFunctions),
                                 [&](const FunctionInfo& f) { return name == f.name; });
    if (at == std::end(kFunctions)) throw std::invalid_argument("unknown function '" + name + "'");
    return static_cast<uint32_t>(at - std::begin(kFunctions));
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
        case Function::kScaledBessel:
            return scaled_bessel(x);
        default:
            return exp_minus(x);
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
        case Function::kPlainQuotient:
            y[0] = plain_quotient(u, v);
            break;
        case Function::kAngle:
            y[0] = angle(u, v);
            break;
        case Function::kCosineHemisphere:
            put(y, cosine_hemisphere(u, v));
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
            const Vec3<F> d{x[0], x[1], x[2]}, wi = turned(d, henyey_greenstein(x[3], x[4]), x[5]);
            put(y, wi);
            y[3] = henyey_greenstein_pdf(d, wi, x[3]);
            break;
        }
        case Function::kHenyeyGreensteinP:
            y[0] = henyey_greenstein_pdf({x[0], x[1], x[2]}, {x[3], x[4], x[5]}, x[6]);
            break;
        case Function::kFlakes: {
            Flakes<F> facets;
            for (uint32_t k = 0; k < kFlakeFloats; ++k) facets.m[k] = x[8 + k];
            const Vec3<F> d{x[0], x[1], x[2]}, wi = facets.draw(d, x[6], x[7]);
            put(y, wi);
            y[3] = facets.value(d, wi), y[4] = facets.value(d, {x[3], x[4], x[5]});
            y[5] = facets.area(d);
            break;
        }
        default: {
            const Vec3<F> d{x[0], x[1], x[2]}, wi = turned(d, rayleigh(x[3]), x[4]);
            put(y, wi);
            y[3] = rayleigh_pdf(dot(d, wi));
        }
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

template <class L>
VR_HD void evaluate_light(Function which, const typename L::F* x, typename L::F* y) {
    using F = typename L::F;
    const F one(1.f), none(0.f);
    const HookSky sky;
    if (which == Function::kLight) {
        const LightSample<L> s =
            AllLights<L>::sample_li(light_of<L>(x, x[13], x[14], sky.map()), {x[15], x[16], x[17]},
                                    {x[15], x[16], x[17]}, x[18], x[19], one < none);
        put(y, s.wi);
        y[3] = one / s.inverse_pdf, y[4] = s.distance, y[5] = s.radiance[0];
        y[6] = select(s.delta, one, none);
        return;
    }
    if (which == Function::kLightPdf) {
        const Vec3<F> n{x[10], x[11], x[12]}, p{x[14], x[15], x[16]}, wi{x[17], x[18], x[19]};
        const F cosine = -dot(n, wi), t = dot(n, p - Vec3<F>{x[1], x[2], x[3]}) / cosine;
        const LightPdf<F> pdf = AllLights<L>::pdf_li(light_of<L>(x, none, x[13], sky.map()),
                                                     {p, t, cosine, x[13]}, none < one);
        y[0] = pdf.over / pdf.under;
        return;
    }
    const LightEmission<L> e =
        AllLights<L>::emit(light_of<L>(x, x[13], x[14], sky.map()), {x[15], x[16], x[17], x[18]});
    put(y, e.p), put(y + 3, e.d);
    y[6] = e.cosine, y[7] = e.radiance[0], y[8] = e.pdf_area, y[9] = e.pdf_sa;
}

template <class L>
VR_HD void evaluate_power(const typename L::F* x, typename L::F* y) {
    float column[5][L::kWidth], power[L::kWidth] = {};
    for (uint32_t c = 0; c < 5; ++c) store(column[c], x[c]);
    for (uint32_t k = 0; k < L::kWidth; ++k) {
        LightSource s{};
        s.shape = static_cast<uint32_t>(column[0][k]);
        s.area = to_double(column[1][k]), s.strength = to_double(column[2][k]);
        s.cutoff = to_double(column[3][k]), s.beam = to_double(column[4][k]);
        with_shape(s.shape, [&](auto shape) { power[k] = static_cast<float>(shape.power(s)); });
    }
    y[0] = load(power, typename L::F());
}

template <class F>
VR_HD auto word_of(F high, F low) {
    return (to_uint(high) << 16) | to_uint(low);
}

template <class L>
VR_HD void evaluate_optics(Function which, const typename L::F* x, typename L::F* y) {
    using F = typename L::F;
    using S = Spectrum<F>;
    if (which == Function::kFresnelDielectric) {
        const FresnelSplit<F> f = fresnel_dielectric(x[0], x[1]);
        y[0] = f.reflected, y[1] = f.cos_t;
    } else if (which == Function::kFresnelConductor) {
        y[0] = fresnel_conductor(x[0], x[1], x[2]);
    } else if (which == Function::kFreeFlight) {
        const S none = S::all(F(0.f)), one = S::all(F(1.f));
        y[0] = free_flight(S::all(x[0]), one, F(0.f), word_of(x[2], x[3]), false);
        y[1] = F(1.f) - flight_weight(S::all(x[0]), none, one, y[0], x[1], false)[0];
    } else {
        const S sigma = S::from(x), throughput = S::from(x + 6);
        y[0] = free_flight(sigma, throughput, x[10], word_of(x[11], x[12]), true);
        put(y + 1, flight_weight(sigma, S::from(x + 3), throughput, y[0], x[9], true));
    }
}

template <class L>
VR_HD void evaluate_film(const typename L::F* x, typename L::F* y) {
    PixelSum sums[L::kWidth] = {};
    if constexpr (L::kWidth == 1) {
        for (uint32_t s = 0; s < kLaneSamples; ++s) add_sample(sums[0], 0, x[s ? 1 : 0]);
    } else {
        LaneSums<L> lanes;
        for (uint32_t s = 0; s < kLaneSamples; ++s) lanes.add(x[s ? 1 : 0]);
        lanes.flush(sums, 0, L::kWidth);
    }
    for (uint32_t i = 0; i < 16; ++i) {
        float column[L::kWidth];
        for (uint32_t k = 0; k < L::kWidth; ++k) {
            const Fixed128 a = i < 8 ? sums[k].sum[0] : sums[k].square[0];
            column[k] = static_cast<float>(((i & 4u ? a.hi : a.lo) >> 16 * (i & 3u)) & 0xffffu);
        }
        y[i] = load(column, typename L::F());
    }
}

// x: kFunctions[which].inputs lanes; y: outputs.
template <class L>
VR_HD void evaluate(uint32_t which, const typename L::F* x, typename L::F* y) {
    using F = typename L::F;
    const Function f = static_cast<Function>(which);
    if (f <= Function::kScaledBessel) {
        y[0] = evaluate_elementary(f, x[0]);
    } else if (f <= Function::kFlakes) {
        evaluate_mapping(f, x, y);
    } else if (f == Function::kSphere) {
        evaluate_sphere<L>(x, y);
    } else if (f >= Function::kBsdfSample && f <= Function::kBsdfEval) {
        evaluate_bsdf<L>(f != Function::kBsdfEval, f == Function::kBsdfSample, x, y);
    } else if (f >= Function::kLight && f <= Function::kLightEmission) {
        evaluate_light<L>(f, x, y);
    } else if (f == Function::kLightPower) {
        evaluate_power<L>(x, y);
    } else if (f == Function::kFilmSums) {
        evaluate_film<L>(x, y);
    } else if (f == Function::kFilmAccepts) {
        const F yes(1.f), no(0.f);
        y[0] = select(film_accepts<false>(Spectrum<F>::from(x), 0.25f), yes, no);
        y[1] = select(film_accepts<true>(Spectrum<F>::from(x), 0.25f), yes, no);
    } else if (f > Function::kConeOfSphere) {
        evaluate_optics<L>(f, x, y);
    } else {
        const Vec3<F> p{x[8], x[9], x[10]};
        const SphereLightSample<F> s = sample_sphere_light(x, p, x[11], x[12]);
        put(y, s.wi);
        y[3] = F(1.f) / s.inverse_pdf, y[4] = s.distance, y[5] = s.cos_light;
        y[6] = sphere_light_pdf(x, p);
    }
}

}  // namespace veriray
