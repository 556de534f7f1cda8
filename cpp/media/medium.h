// Homogeneous media. Free flights are sampled for one channel, chosen by throughput, and weighted
// by the balance heuristic over the channels: weights stay bounded for any colour (A. Wilkie et
// al., "Hero Wavelength Spectral Sampling", EGSR 2014).
#pragma once

#include "core/mapping.h"
#include "core/math.h"

namespace veriray {

// Columns by medium; lengths are normalised.
enum MediumColumn : uint32_t {
    kMediumSigma,                      // extinction: 3 columns
    kMediumAlbedo = kMediumSigma + 3,  // 3 columns
    kMediumG = kMediumAlbedo + 3,      // mean cosine of Henyey and Greenstein's phase function
    kMediumBeyond = kMediumG + 1,      // medium of a ray that meets nothing; itself if unbounded
    kMediumColumns,
};

// exp(-sigma d) by channel; 1 where sigma is 0, whatever d.
template <class F>
VR_HD Vec3<F> transmittance(Vec3<F> sigma, F d) {
    const auto one = [&](F s) { return select(s > F(0.f), exp_minus(s * d), F(1.f)); };
    return {one(sigma.x), one(sigma.y), one(sigma.z)};
}

template <class F>
struct Flight {
    F t;             // distance to the next collision
    Vec3<F> weight;  // of colliding there, or of arriving at `limit` first
};

// u24: 24 bits that choose the channel, in [0, 1); flight: 32 bits. chromatic: false if all media
// of the scene are grey.
template <class F, class U>
VR_HD Flight<F> free_flight(Vec3<F> sigma, Vec3<F> albedo, Vec3<F> throughput, F limit, F u24,
                            U flight, bool chromatic) {
    const Vec3<F> one{F(1.f), F(1.f), F(1.f)};
    const F depth = exponential(flight);
    if (!chromatic) {
        const F t = depth / sigma.x;
        return {t, select(t < limit, albedo, one)};
    }
    const F total = throughput.x + throughput.y + throughput.z;
    const Vec3<F> w = throughput * (F(1.f) / total);
    const F s = select(u24 < w.x, sigma.x, select(u24 < w.x + w.y, sigma.y, sigma.z));
    const F t = depth / s;
    const auto collides = t < limit;
    const Vec3<F> through = transmittance(sigma, min(t, limit));
    const Vec3<F> density = select(collides, through * sigma, through);
    const F pdf = dot(w, density);
    return {t, select(collides, density * albedo, density) * (F(1.f) / pdf)};
}

}  // namespace veriray
