// The building blocks of closures. A closure is a class template on lanes that defines those
// members of Closure that differ from the defaults; closures.def lists all closures.
//
// Directions point away from the surface. A random number of its own selects the lobe, so weights
// do not depend on the selection (section 3.4 of H. Dahlberg, "Parallel Path Tracing in CUDA", KTH,
// 2016).
#pragma once

#include "bsdfs/fresnel.h"
#include "bsdfs/rough_coat.h"
#include "core/mapping.h"
#include "spectrum/spectrum.h"

namespace veriray {

// Parameters of a material, as bits.
enum ParameterBit : uint32_t {
#define VR_PARAMETER(name, width) kParameter_##name,
#include "schema/materials.def"
};
constexpr uint32_t parameter_bit(ParameterBit p) { return 1u << p; }

// Their values, one per lane; a closure sees those that it reads.
template <class F>
struct MaterialParameters {
    template <uint32_t width>
    using Value = std::conditional_t<width == 1, F, Spectrum<F>>;
#define VR_PARAMETER(name, width) Value<width> name;
#include "schema/materials.def"
};

template <class F>
struct BsdfValue {
    Spectrum<F> f_cos;  // f(wo, wi) |cos wi|
    F pdf_sa;           // of the non-delta lobes, their selection included
};

template <class L>
struct BsdfSample {
    Vec3<typename L::F> wi;          // unit, world
    Spectrum<typename L::F> weight;  // f |cos| / pdf
    typename L::F pdf_sa;            // 0 for a delta lobe
    typename L::M transmitted;       // wi lies behind the surface
    typename L::M pass;              // straight through
};

// What is carried along wo: radiance to wo's side, or importance, as light paths carry light.
// Refraction scales radiance alone. E. Veach, "Robust Monte Carlo methods for light transport
// simulation", 1997, section 5.2.
enum class Transport : uint32_t { kRadiance, kImportance };

// A table of a surface's own, which the host makes; see scene/surfaces.cpp.
template <class L>
struct SurfaceTable {
    using F = typename L::F;
    using U = typename L::U;

    const float* columns = nullptr;  // null: no surface has one
    uint32_t stride;
    U row;

    VR_HD F number(U column) const {
        return columns ? gather(columns, column * U(stride) + row) : F(0.f);
    }
    // Linear from a column to the next.
    VR_HD F between(U column, F part) const {
        const U at = column * U(stride) + row;
        const F low = gather(columns, at), high = gather(columns, at + U(stride));
        return fma(part, high - low, low);
    }
    // Of a coat from outside, tabulated over kCoatCells + 1 cosines from 0 to 1.
    VR_HD F transmittance(F cosine) const {
        if (!columns) return F(1.f);
        const F x = max(min(cosine, F(1.f)), F(0.f)) * F(float{kCoatCells});
        const U cell = to_uint(min(x, F(kCoatCells - 1.f)));
        return between(cell, x - to_float(cell));
    }
};

// A surface as seen along wo.
template <class L>
struct ClosureView {
    Transport transport = Transport::kRadiance;
    Vec3<typename L::F> n;                // shading normal on wo's side
    typename L::F cos_o;                  // between wo and n, positive
    FresnelSplit<typename L::F> fresnel;  // for closures with an index
    typename L::F relative;               // for these: index beyond over index on wo's side
    SurfaceTable<L> table;                // for closures that have one
    bool tangents = false;                // whether the tangent is set
    Vec3<typename L::F> tangent;          // unit, perpendicular to n; alpha_u is along it
};

// Three numbers in [0, 1), for a direction and for the selection of a lobe.
template <class F>
struct BsdfNumbers {
    F u, v, lobe;
};

// Defaults: black, opaque, without an index.
template <class L>
struct Closure {
    using F = typename L::F;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;
    using View = ClosureView<L>;
    using Parameters = MaterialParameters<F>;
    using Numbers = BsdfNumbers<F>;
    using Value = BsdfValue<F>;
    using Sample = BsdfSample<L>;

    static constexpr bool kScatters = false;  // has non-delta lobes, which light samples reach
    static constexpr bool kClear = false;     // delta lobes that transmit light: two-sided, and not
                                              // black where normals disagree
    static constexpr bool kRefracts = false;  // changes the direction of transmitted light
    static constexpr bool kPasses = false;    // lets light straight through
    static constexpr bool kReflects = true;   // if false, it only passes
    static constexpr bool kIndexed = false;   // splits light by Fresnel's equations and index()
    static constexpr bool kTransmits = false;    // lobes of eval and sample behind the surface, too
    static constexpr bool kThirdNumber = false;  // reads Numbers::lobe without an index
    static constexpr uint32_t kTable = 0;        // columns that it reads of View::table
    static constexpr bool kFollows = false;      // reads View::tangent, isotropic or not
    static constexpr bool kEitherSide = false;   // light may be on the other side of the face than
                                                 // of the normal: what is within lets it pass

    // For closures with an index: index beyond over index here, and the split of light that follows
    // from the split at one interface.
    static VR_HD F index(const Parameters& p, M) { return p.eta[0]; }
    static VR_HD FresnelSplit<F> split(FresnelSplit<F> one) { return one; }

    static VR_HD M black(const Parameters&, M nobody) { return nobody; }

    // These have no default, so that none is forgotten: sample(parameters, view, wo, numbers,
    // nobody); albedo(parameters, view), the share of light from wo that goes on, for feature
    // images; for closures that scatter, eval(parameters, view, wo, wi, cos_i), whose density is
    // that of sampling wi as seen from wo (cos_i < 0 asks those that transmit alone); for those
    // that pass, pass_through(parameters, view), the share that goes straight through; for clear
    // ones that reflect, sample_again(parameters, view, wo, through), the same lobe about the
    // view's normal.

    // A delta lobe.
    static VR_HD Sample delta(V wi, S weight, M nobody) {
        return {wi, weight, F(0.f), nobody, nobody};
    }
    // The Lambertian lobe on wo's side; its weight is 1.
    static VR_HD Sample cosine_lobe(const View& view, F u, F v, F& cos_i, M nobody) {
        const V local = cosine_hemisphere(u, v);
        V a, b;
        orthonormal_frame(view.n, a, b);
        cos_i = local.z;
        return {fma(a, local.x, fma(b, local.y, view.n * local.z)), S::all(F(1.f)),
                cosine_hemisphere_pdf_sa(local.z), nobody, nobody};
    }
    static VR_HD M either(M first, M a, M b) { return (first & a) | (b & !first); }
    static VR_HD Sample chosen(M first, const Sample& a, const Sample& b) {
        return {select(first, a.wi, b.wi), select(first, a.weight, b.weight),
                select(first, a.pdf_sa, b.pdf_sa), either(first, a.transmitted, b.transmitted),
                either(first, a.pass, b.pass)};
    }
};

// Takes the members of Closure<L> into a closure.
#define VR_CLOSURE(L)                                                                            \
    using typename Closure<L>::F, typename Closure<L>::M, typename Closure<L>::V;                \
    using typename Closure<L>::S, typename Closure<L>::View, typename Closure<L>::Parameters;    \
    using typename Closure<L>::Numbers, typename Closure<L>::Value, typename Closure<L>::Sample; \
    using Closure<L>::delta, Closure<L>::cosine_lobe, Closure<L>::chosen

}  // namespace veriray
