// Phase functions: where light goes that a medium scatters.
//
// That of a medium is a sum of lobes with shares that add up to 1. A lobe is chosen by chances that
// are multiples of 2^-24, and a direction by it. What a path is multiplied by is the sum's value
// over the density of what is drawn, so that the rounding of the chances is no bias.
#pragma once

#include "core/intervals.h"
#include "core/mapping.h"
#include "media/flakes.h"

namespace veriray {

// Kinds of lobes, in the order of PHASE_KINDS in columns.py.
enum PhaseKind : uint32_t { kHenyeyGreenstein, kRayleigh, kTabulated, kFlakes };

enum LobeColumn : uint32_t {
    kLobeKind,    // PhaseKind
    kLobeShare,   // of the phase function
    kLobeG,       // Henyey and Greenstein's
    kLobeCells,   // of a table: pieces between its values
    kLobeFirst,   // of a table: where its values and its intervals begin; bits
    kLobeGuide,   // of a table: where its guide begins; bits
    kLobeFlakes,  // kFlakeFloats columns
    kLobeColumns = kLobeFlakes + kFlakeFloats,
};

// A table holds values at cosines from -1 to 1 in equal steps, per solid angle, and for each piece
// between two of them the chance that it is drawn over its integral.
struct PhaseView {
    const float* lobes;            // [column][stride]; those of a medium one after another
    const float* values;           // of the tables
    const float* drawn;            // of the pieces; a table has one more, which is not used
    const float* ends;             // of intervals: of the lobes, then of the pieces of tables
    const uint32_t* guides;        // by medium 2, of no bits, then of the tables
    uint32_t stride, count, most;  // most: lobes of one medium
    uint32_t bits;                 // of the tables' guides
    uint32_t flakes;               // whether there are any
};

// A turn from one direction of travel to another.
template <class F>
struct Turn {
    F cosine, sine;
};

// The direction at a turn from d, at the azimuth of v in [0, 1). The result is normalised, so its
// length does not drift over many scatterings.
template <class F>
VR_HD Vec3<F> turned(Vec3<F> d, Turn<F> turn, F v) {
    F s, c;
    sincos_2pi(v, s, c);
    Vec3<F> x, y;
    orthonormal_frame(d, x, y);
    const Vec3<F> wi = fma(x, turn.sine * c, fma(y, turn.sine * s, d * turn.cosine));
    return wi * (F(1.f) / sqrt(dot(wi, wi)));
}

// L. Henyey, J. Greenstein, Astrophysical Journal 93, 1941, with mean cosine g in (-1, 1) between
// the old and the new direction of travel. Everything is a product or a sum of positive terms of
// |g|, so no precision is lost for g near 0 or +-1; negative g is mirrored.
//
// With w = 1 - |g| + 2 |g| u, u = 0 backward:
// 1 - cos = 2 (1 - |g|)^2 (1 - u) (1 + |g| u) / w^2
// 1 + cos = 2 (1 + |g|)^2 u (1 - |g| + |g| u) / w^2.
template <class F>
VR_HD Turn<F> henyey_greenstein(F g, F u) {
    const F a = abs(g), one(1.f);
    const F less = one - a, w = fma(F(2.f) * a, u, less);
    const F scale = F(2.f) * less / (w * w);
    const F forward = (one - u) * fma(a, u, one), backward = u * fma(a, u, less);
    const F cosine = one - scale * less * forward;
    const F sine = scale * (one + a) * sqrt(forward * backward);
    return {select(g < F(0.f), -cosine, cosine), sine};
}

// Its density per solid angle at w. Computed from 1 - cos = |d - w|^2 / 2 (negative g: 1 + cos),
// because a rounded cosine does not resolve small angles.
template <class F>
VR_HD F henyey_greenstein_pdf(Vec3<F> d, Vec3<F> w, F g) {
    const Vec3<F> apart = w - select(g < F(0.f), -d, d);
    const F a = abs(g), less = F(1.f) - a;
    const F base = fma(a, dot(apart, apart), less * less);
    return F(0.25f * kInvPi) * less * (F(1.f) + a) / (base * sqrt(base));
}

// Lord Rayleigh, Philosophical Magazine 41, 1871: 3 / (16 pi) (1 + cos^2), without polarisation.
// u = 0 backward. h = 1 - |cos| solves h^3 - 3 h^2 + 6 h = 4 t, where t is the share of directions
// that are nearer to their pole. Newton's method from a cubic, which is off by 0.8 % of h at most;
// two steps leave 5e-13 of it.
template <class F>
VR_HD Turn<F> rayleigh(F u) {
    const F t = F(2.f) * min(u, F(1.f) - u);
    F h = t * fma(t, fma(t, F(0.1127f), F(0.23f)), F(0.6654f));
    for (int k = 0; k < 2; ++k)
        h = fma(h * h, fma(F(2.f), h, F(-3.f)), F(4.f) * t) / fma(F(3.f) * h, h - F(2.f), F(6.f));
    const F cosine = F(1.f) - h;
    return {select(u < F(0.5f), -cosine, cosine), sqrt(h * (F(2.f) - h))};
}
template <class F>
VR_HD F rayleigh_pdf(F cosine) {
    return fma(cosine, cosine, F(1.f)) * F(0.1875f * kInvPi);
}

// The phase function of a medium, by lane. kLobes: else that of Henyey and Greenstein alone.
template <class L, bool kLobes>
struct Phase {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;

    F g;
    U medium, first, count;  // with lobes

    struct Value {
        F value, pdf_sa;  // per solid angle: of the function, and of what is drawn
    };

    VR_HD Value eval(const PhaseView& view, V d, V wi, M lanes) const {
        if (!kLobes || !view.most) {
            const F value = henyey_greenstein_pdf(d, wi, g);
            return {value, value};
        }
        const F cosine = dot(d, wi);
        Value sum{F(0.f), F(0.f)};
        for (uint32_t i = 0; i < view.most; ++i) {
            const M m = lanes & (U(i) < count);
            if (none(m)) break;
            const U lobe = select(m, first + U(i), U(0u));
            const F kind = column(view, lobe, kLobeKind);
            F value = select(is(kind, kRayleigh), rayleigh_pdf(cosine),
                             henyey_greenstein_pdf(d, wi, column(view, lobe, kLobeG)));
            F pdf = value;
            const M tables = m & is(kind, kTabulated);
            if (any(tables)) tabulated(view, lobe, cosine, tables, value, pdf);
            if (view.flakes) {
                const M facets = m & is(kind, kFlakes);
                if (any(facets)) {
                    value = select(facets, flakes(view, lobe).value(d, wi), value);
                    pdf = select(facets, value, pdf);
                }
            }
            const F chance = intervals(view, first).size(select(m, U(i), U(0u)));
            sum.value = select(m, fma(column(view, lobe, kLobeShare), value, sum.value), sum.value);
            sum.pdf_sa = select(m, fma(chance * F(0x1p-24f), pdf, sum.pdf_sa), sum.pdf_sa);
        }
        return sum;
    }

    // choice: in [0, 1), of the lobe.
    VR_HD V sample(const PhaseView& view, V d, F choice, F u, F v, M lanes) const {
        if (!kLobes || !view.most) return turned(d, henyey_greenstein(g, u), v);
        F rest;
        const U place = intervals(view, first).choose(view.guides, medium << 1, 0, choice, rest);
        const U lobe = select(lanes, first + place, U(0u));
        const F kind = column(view, lobe, kLobeKind);
        Turn<F> turn = henyey_greenstein(column(view, lobe, kLobeG), u);
        const M round = lanes & is(kind, kRayleigh), tables = lanes & is(kind, kTabulated);
        if (any(round)) turn = chosen(round, rayleigh(u), turn);
        if (any(tables)) turn = chosen(tables, tabulated(view, lobe, u, tables), turn);
        V wi = turned(d, turn, v);
        if (view.flakes) {
            const M facets = lanes & is(kind, kFlakes);
            if (any(facets)) wi = select(facets, flakes(view, lobe).draw(d, u, v), wi);
        }
        return wi;
    }

    static VR_HD Flakes<F> flakes(const PhaseView& view, U lobe) {
        Flakes<F> facets;
        for (uint32_t k = 0; k < kFlakeFloats; ++k)
            facets.m[k] = column(view, lobe, kLobeFlakes + k);
        return facets;
    }

   private:
    static VR_HD F column(const PhaseView& view, U lobe, uint32_t c) {
        return lookup(view.lobes + c * view.stride, lobe, view.count);
    }
    static VR_HD M is(F kind, PhaseKind k) { return kind == F(static_cast<float>(k)); }
    static VR_HD Intervals<L> intervals(const PhaseView& view, U base) { return {view.ends, base}; }
    static VR_HD Turn<F> chosen(M m, Turn<F> a, Turn<F> b) {
        return {select(m, a.cosine, b.cosine), select(m, a.sine, b.sine)};
    }
    // The first value of a table, which is its first interval too.
    static VR_HD U values(const PhaseView& view, U lobe, M m) {
        return select(m, as_uint(column(view, lobe, kLobeFirst)), U(0u));
    }

    static VR_HD void tabulated(const PhaseView& view, U lobe, F cosine, M m, F& value, F& pdf) {
        const F cells = column(view, lobe, kLobeCells);
        const F at = min(max((cosine + F(1.f)) * (cells * F(0.5f)), F(0.f)), cells);
        const F piece = min(floor(at), cells - F(1.f));
        const U i = values(view, lobe, m) + to_uint(select(m, piece, F(0.f)));
        const F here = between(gather(view.values, i), gather(view.values, i + U(1u)), at - piece);
        value = select(m, here, value);
        pdf = select(m, here * gather(view.drawn, i), pdf);
    }
    static VR_HD Turn<F> tabulated(const PhaseView& view, U lobe, F u, M m) {
        const U first = values(view, lobe, m);
        const U guide = select(m, as_uint(column(view, lobe, kLobeGuide)), U(0u));
        F rest;
        const U piece =
            intervals(view, first + U(view.count)).choose(view.guides, guide, view.bits, u, rest);
        const F cells = column(view, lobe, kLobeCells), before = to_float(piece);
        const F s = linear_place(gather(view.values, first + piece),
                                 gather(view.values, first + piece + U(1u)), rest);
        // 1 + cos and 1 - cos
        const F up = F(2.f) * (before + s) / cells;
        const F down = F(2.f) * (cells - F(1.f) - before + (F(1.f) - s)) / cells;
        return {(up - down) * F(0.5f), sqrt(up * down)};
    }
};

}  // namespace veriray
