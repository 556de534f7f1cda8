// Homogeneous media. Free flights are sampled for one channel, chosen by throughput, and weighted
// by the balance heuristic over the channels: weights stay bounded for any colour (A. Wilkie et
// al., "Hero Wavelength Spectral Sampling", EGSR 2014).
#pragma once

#include "core/mapping.h"
#include "core/math.h"
#include "media/phase.h"
#include "spectrum/spectrum.h"

namespace veriray {

// Columns by medium; lengths are normalised.
enum MediumColumn : uint32_t {
    kMediumSigma,                      // extinction: 3 columns
    kMediumAlbedo = kMediumSigma + 3,  // 3 columns
    kMediumG = kMediumAlbedo + 3,      // mean cosine of Henyey and Greenstein's phase function
    kMediumLobe,                       // with kPhases: the first lobe of the phase function
    kMediumLobes,                      // and how many it has
    kMediumFlakes,                     // with kPhases: the lobe whose flakes it is of; -1: none
    kMediumBeyond,                     // medium for a ray that meets nothing; itself if unbounded
    kMediumShut,                       // 1: no light sample arrives from within
    kMediumAlbedoGrid,                 // a factor on the albedo; -1: none
    kMediumSigmaGrid,                  // the share of the extinction that is there; -1: none
    kMediumColumns,
};

// exp(-sigma d) by channel; 1 where sigma is 0, whatever d.
template <class F>
VR_HD Spectrum<F> transmittance(const Spectrum<F>& sigma, F d) {
    return Spectrum<F>::of(
        [&](uint32_t k) { return select(sigma[k] > F(0.f), exp_minus(sigma[k] * d), F(1.f)); });
}

// The distance to the next collision. u24: 24 bits in [0, 1) that choose the channel; flight: 32
// bits. chromatic: false if all media of the scene are grey.
template <class F, class U>
VR_HD F free_flight(const Spectrum<F>& sigma, const Spectrum<F>& throughput, F u24, U flight,
                    bool chromatic) {
    const F depth = exponential(flight);
    return depth / (chromatic ? choose(sigma, shares(throughput), u24) : sigma[0]);
}

// The weight of colliding at t, or of arriving at `limit` first.
template <class F>
VR_HD Spectrum<F> flight_weight(const Spectrum<F>& sigma, const Spectrum<F>& albedo,
                                const Spectrum<F>& throughput, F t, F limit, bool chromatic) {
    if (!chromatic) return select(t < limit, albedo, Spectrum<F>::all(F(1.f)));
    const auto collides = t < limit;
    const Spectrum<F> w = shares(throughput);
    const Spectrum<F> through = transmittance(sigma, min(t, limit));
    const Spectrum<F> density = select(collides, through * sigma, through);
    const F pdf = inner(w, density);
    return select(collides, density * albedo, density) * (F(1.f) / pdf);
}

}  // namespace veriray
