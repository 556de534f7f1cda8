// A fibre of hair or fur: light that its surface reflects, that goes through, that is reflected
// once within, and the rest. M. J.-Y. Chiang, B. Bitterli, C. Tappan, B. Burley, "A Practical and
// Controllable Hair and Fur Model for Production Path Tracing", Computer Graphics Forum 35(2),
// 2016.
//
// The fibre lies along t = n x s, where s is the tangent. Where light meets it across its width
// follows from the direction and the normal. All that it sends leaves from there.
#pragma once

#include "bsdfs/closure.h"

namespace veriray {

template <class L>
struct Hair : Closure<L> {
    VR_CLOSURE(L);
    static constexpr const char* kName = "hair";
    static constexpr bool kScatters = true, kTransmits = true, kRefracts = true, kIndexed = true;
    static constexpr bool kFollows = true, kEitherSide = true;
    static constexpr uint32_t kReads = parameter_bit(kParameter_eta) | parameter_bit(kParameter_k) |
                                       parameter_bit(kParameter_hair_along) |
                                       parameter_bit(kParameter_hair_around) |
                                       parameter_bit(kParameter_hair_tilt);

    // What lies beyond is what lies around the fibre.
    static VR_HD F index(const Parameters&, M) { return F(1.f); }

    static VR_HD S albedo(const Parameters& p, const View&) {  // of its middle
        return Fibre(p, {F(0.f), F(0.f), F(1.f)}).all();
    }

    static VR_HD Value eval(const Parameters& p, const View& view, V wo, V wi, F cos_i) {
        V x, y;
        const Fibre fibre = seen(p, view, wo, x, y);
        return fibre.eval({dot(x, wi), dot(y, wi), cos_i});
    }

    static VR_HD Sample sample(const Parameters& p, const View& view, V wo, Numbers r, M nobody) {
        V x, y;
        const Fibre fibre = seen(p, view, wo, x, y);
        const V i = fibre.draw(r);
        const V wi = renormalised(fma(x, i.x, fma(y, i.y, view.n * i.z)));
        const F cos_i = dot(view.n, wi), none(0.f);
        const Value found = fibre.eval({dot(x, wi), dot(y, wi), cos_i});
        const M right = found.pdf_sa > none;
        return {wi, select(right, found.f_cos * (F(1.f) / found.pdf_sa), S::all(none)),
                select(right, found.pdf_sa, none), cos_i < none, nobody};
    }

   private:
    struct Fibre;
    static constexpr uint32_t kLobes = 4;
    static constexpr float kTwoPi = 2 * kPi, kPerTurn = 0.5f * kInvPi;

    // x, y: the axes of the fibre's frame beside the normal.
    static VR_HD Fibre seen(const Parameters& p, const View& view, V wo, V& x, V& y) {
        orthonormal_frame(view.n, x, y);
        if (view.tangents) x = view.tangent, y = cross(view.n, view.tangent);
        return Fibre(p, {dot(x, wo), dot(y, wo), view.cos_o});
    }

    // A fibre as seen along wo. Angles about it are in radians from n towards s.
    struct Fibre {
        F sine, cosine;          // of wo's slope along the fibre
        F out, in;               // wo's angle about it; half the turn of light within, less pi/2
        F scale, tail;           // of the logistic; e^(-pi / scale)
        F sines[3], cosines[3];  // of the tilts of the first lobes
        F variances[kLobes], chances[kLobes];
        S shares[kLobes];  // of the light

        VR_HD Fibre(const Parameters& p, V o) {
            const F one(1.f), none(0.f), eta = p.eta[0];
            sine = o.y, cosine = sqrt(fma(o.x, o.x, o.z * o.z));
            out = angle(o.z, o.x);
            // Below an index of 1 some of the light does not enter: r = 1, and h is beyond 1.
            // Above it the square is 2^-22 at least, so the guard does nothing. It keeps the path
            // below 2^52, and its product with k (2^20 at most) finite: k = 0 absorbs nothing.
            const F rest = sqrt(max(fma(cosine, cosine, fma(eta, eta, -one)), F(0x1p-100f)));
            const F h = max(min(o.x / rest, one), -one);  // sine; within: cosine
            const F within = sqrt(max(fma(-h, h, one), none));
            in = angle(within, h);
            const F r = fresnel_dielectric(min(o.z, one), eta).reflected;
            const F path = F(2.f) * within * eta / rest;
            const S t = S::of([&](uint32_t k) { return exp_minus(p.k[k] * path); });
            shares[0] = S::all(r);
            shares[1] = t * ((one - r) * (one - r));
            shares[2] = shares[1] * t * r;
            // 1 - again is a multiple of 2^-24, and 0 only if r = 1, where shares[2] is 0, too.
            shares[3] = S::of([&](uint32_t k) {
                const F again = t[k] * r;
                return shares[2][k] * again / max(one - again, F(0x1p-24f));
            });
            // Of less than 2^-100 of the light, the rest of the chance goes to the last lobe;
            // weights are then 2^-100 at most.
            const F total = max(sum(all()), F(0x1p-100f));
            for (uint32_t k = 0; k < kLobes; ++k) chances[k] = sum(shares[k]) / total;

            variances[0] = p.hair_along, variances[1] = F(0.25f) * p.hair_along;
            variances[2] = variances[3] = F(4.f) * p.hair_along;
            scale = p.hair_around, tail = exp_minus(F(kPi) / scale);
            // Of once, twice and four times the angle of the scales.
            F s = p.hair_tilt, c = sqrt(fma(-s, s, one));
            const F s2 = F(2.f) * s * c, c2 = fma(F(-2.f) * s, s, one);
            sines[0] = -s2, cosines[0] = c2;
            sines[1] = s, cosines[1] = c;
            sines[2] = F(2.f) * s2 * c2, cosines[2] = fma(F(-2.f) * s2, s2, one);
        }

        VR_HD S all() const { return (shares[0] + shares[1]) + (shares[2] + shares[3]); }

        // The slope about which light of a lobe leaves, negated.
        VR_HD void tilted(uint32_t lobe, F& s, F& c) const {
            s = sine, c = cosine;
            if (lobe == 3) return;
            s = fma(sine, cosines[lobe], cosine * sines[lobe]);
            c = abs(fma(cosine, cosines[lobe], -sine * sines[lobe]));
        }
        // The angle about the fibre at which light of a lobe leaves, from that of wo.
        VR_HD F turned(uint32_t lobe) const {
            return fma(F(2.f * static_cast<float>(lobe)), in, F(-2.f) * out) +
                   F(kPi * static_cast<float>(lobe));
        }
        // Within half a turn.
        static VR_HD F wrapped(F x) {
            return fma(floor(fma(x, F(kPerTurn), F(0.5f))), F(-kTwoPi), x);
        }

        VR_HD Value eval(V i) const {
            const F one(1.f), up = sqrt(fma(i.x, i.x, i.z * i.z));
            const F about = angle(i.z, i.x) - out;
            Value value{S::all(F(0.f)), F(0.f)};
            for (uint32_t lobe = 0; lobe < kLobes; ++lobe) {
                F s, c;
                tilted(lobe, s, c);
                const F v = variances[lobe], over = one / v;
                const F a = i.y + s, b = up - c;
                const F along = exp_minus(F(0.5f) * over * fma(a, a, b * b)) *
                                scaled_bessel(up * c * over) * over /
                                (one - exp_minus(F(2.f) * over));
                F around(kPerTurn);
                if (lobe < 3) {
                    const F e = exp_minus(abs(wrapped(about - turned(lobe))) / scale);
                    around = e * (one + tail) / (scale * (one + e) * (one + e) * (one - tail));
                }
                value.f_cos = value.f_cos + shares[lobe] * (along * around);
                value.pdf_sa = fma(chances[lobe], along * around, value.pdf_sa);
            }
            return value;
        }

        VR_HD V draw(Numbers r) const {
            const F one(1.f), none(0.f);
            F before(0.f), s = sine, c = cosine, v = variances[3], mean(0.f), chance(0.f);
            M open = r.lobe < one, even = open & !open;
            for (uint32_t lobe = 0; lobe < kLobes; ++lobe) {
                M take = open;
                if (lobe + 1 < kLobes) take = take & (r.lobe < before + chances[lobe]);
                F ts, tc;
                tilted(lobe, ts, tc);
                s = select(take, ts, s), c = select(take, tc, c);
                v = select(take, variances[lobe], v);
                mean = select(take, turned(lobe), mean);
                chance = select(take, chances[lobe], chance);
                even = lobe == 3 ? take : even;
                open = open & !take;
                before = select(open, before + chances[lobe], before);
            }
            const F left = (r.lobe - before) / chance;  // of the number that chose
            const F u = one - r.u;
            const F cos_a = fma(v, log(fma(r.u, exp_minus(F(2.f) / v), u)), one);
            const F sin_a = sqrt(max(fma(-cos_a, cos_a, one), none));
            F sin_b, cos_b;
            sincos_2pi(max(min(left, F(0x1.fffffep-1f)), none), sin_b, cos_b);
            const F y = fma(sin_a * cos_b, c, -cos_a * s);
            const F up = sqrt(max(fma(-y, y, one), none));
            // The logistic's inverse, at the middle of the number's cell.
            const F k = (one - tail) / (one + tail), low = tail / (one + tail);
            const F w = r.v + F(0x1p-25f), rest = (one - r.v) - F(0x1p-25f);
            const F x = scale * (log(fma(w, k, low)) - log(fma(rest, k, low)));
            const F about = select(even, r.v * F(kTwoPi), mean + x) + out;
            const F turns = about * F(kPerTurn);
            F sin_i, cos_i;
            sincos_2pi(max(min(turns - floor(turns), F(0x1.fffffep-1f)), none), sin_i, cos_i);
            return {up * sin_i, y, up * cos_i};
        }
    };
};

}  // namespace veriray
