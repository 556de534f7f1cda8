// The lights of a scene by lane: a light's shape's functions for the shapes that can occur. tree.h
// chooses one.
#pragma once

#include "lights/shapes.h"

namespace veriray {

// kShapes: those that can occur. kTouching: some lamps may touch what lets light through.
template <class L, uint32_t kShapes, bool kTouching>
struct Lights {
    using F = typename L::F;
    using U = typename L::U;
    using M = typename L::M;
    using V = Vec3<F>;
    using S = Spectrum<F>;

    static constexpr bool has(uint32_t shapes) { return (kShapes & shapes) != 0; }

    // Calls visit(shape, lanes that are it) for the shapes of kWanted that can occur.
    template <uint32_t kWanted, class Row, class Visit>
    static VR_HD void each(const Row& row, Visit visit) {
#define VR_VISIT(T) \
    if constexpr (has(kWanted & shape_bit(k##T))) visit(T<L>(), row.is(k##T));
        VR_LIGHTS(VR_VISIT)
#undef VR_VISIT
    }
    // Lanes of those shapes.
    template <uint32_t kWanted, class Row>
    static VR_HD M any_of(const Row& row, M nobody) {
        M found = nobody;
        each<kWanted>(row, [&](auto, M m) VR_INLINED { found = found | m; });
        return found;
    }

    // A light as seen from the receiver p, whose shadow rays start at `from`; u, v in [0, 1).
    template <class Row>
    static VR_HD LightSample<L> sample_li(const Row& row, V p, V from, F u, F v, M nobody) {
        LightSample<L> s;
        s.delta = nobody;
        s.skip = U(~0u);
        if constexpr (has(kFlatShapes)) {
            FlatPlace<L> at{u, v, as_uint(row(kLightPrimitive)), nobody, F(0.f)};
            each<kSpreadShapes>(row, [&](auto shape, M m) VR_INLINED {
                F a, b;
                shape.spread(u, v, a, b);
                at.u = select(m, a, at.u);
                at.v = select(m, b, at.v);
            });
            each<kByAngleShapes>(row, [&](auto shape, M m) VR_INLINED {
                if (any(m)) shape.place(row, p, u, v, m, at);
            });
            each<kPairedShapes>(row, [&](auto, M m) VR_INLINED {
                at.skip = select(m & (at.u >= at.v), as_uint(row(kLightOther)), at.skip);
            });
            s = sample_flat<L, has(kByAngleShapes), kTouching>(row, p, from, at, nobody);
        }
        each<kSampledShapes & ~(kFlatShapes | kPointShapes)>(row, [&](auto shape, M m) VR_INLINED {
            if (none(m)) return;
            LightSample<L> one = shape.sample_li(row, p, from, u, v, m, nobody);
            if constexpr (shape.kSite != kOnSurface) one.aim = one.wi;
            merge(s, m, one);
        });
        if constexpr (has(kPointShapes)) {
            const M point = any_of<kPointShapes>(row, nobody);
            if (any(point)) {
                LightSample<L> one = PointLight<L>::sample_li(row, p, from, point);
                each<kConeShapes>(row, [&](auto shape, M m) VR_INLINED {
                    if (any(m))
                        one.radiance =
                            select(m, one.radiance * shape.falloff(row, one.wi), one.radiance);
                });
                merge(s, point, one);
            }
        }
        return s;
    }

    // Where the way wi from a receiver meets a light's image, of lights that may have one.
    template <class Row>
    static VR_HD void image(const Row& row, V wi, F& u, F& v) {
        each<kImageShapes>(row, [&](auto shape, M m) VR_INLINED {
            if (none(m)) return;
            F a, b;
            shape.image(row, wi, a, b);
            u = select(m, a, u);
            v = select(m, b, v);
        });
    }

    // The point of a sample of a lamp.
    template <class Row>
    static VR_HD V point(const Row& row, V place) {
        V p = place;
        each<kRoundShapes>(
            row, [&](auto shape, M m) VR_INLINED { p = select(m, shape.point(row, place), p); });
        return p;
    }

    static VR_HD void merge(LightSample<L>& s, M m, const LightSample<L>& other) {
        s.radiance = select(m, other.radiance, s.radiance);
        s.inverse_pdf = select(m, other.inverse_pdf, s.inverse_pdf);
        s.distance = select(m, other.distance, s.distance);
        s.wi = select(m, other.wi, s.wi);
        s.delta = s.delta | (m & other.delta);
        s.skip = select(m, other.skip, s.skip);
        s.on = select(m, other.on, s.on);
        s.place = select(m, other.place, s.place);
        s.aim = select(m, other.aim, s.aim);
    }

    // The density of light samples where a ray meets a lamp.
    template <class Row>
    static VR_HD LightPdf<F> pdf_li(const Row& row, const LightHit<L>& at, M lanes) {
        LightPdf<F> pdf = at.by_area();
        each<kOwnPdfShapes>(row, [&](auto shape, M m) VR_INLINED {
            if (any(lanes & m)) {
                const LightPdf<F> own = shape.pdf_li(row, at);
                pdf.over = select(m, own.over, pdf.over);
                pdf.under = select(m, own.under, pdf.under);
            }
        });
        return pdf;
    }

    // The sky's radiance along d; weight(pdf) is that of a direction against its light samples, as
    // seen from the place where it was drawn.
    template <class Row, class Weight>
    static VR_HD S sky(const Row& row, V d, V from, Weight weight) {
        S light = S::all(F(0.f));
        each<kSkyShapes>(row, [&](auto shape, M m) VR_INLINED {
            constexpr uint32_t kSkies = kShapes & kSkyShapes;
            constexpr bool kOnly = (kSkies & (kSkies - 1u)) == 0;
            if (!kOnly && none(m)) return;  // an image that is not there
            S one = shape.radiance(row, d);
            if constexpr (decltype(shape)::kSampled) one = one * weight(shape.pdf_li(row, d, from));
            light = kOnly ? one : select(m, one, light);
        });
        return light;
    }

    // Light that leaves a light.
    template <class Row>
    static VR_HD LightEmission<L> emit(const Row& row, EmissionNumbers<F> r) {
        const V zero{F(0.f), F(0.f), F(0.f)};
        LightEmission<L> e{zero, zero, S::all(F(0.f)), F(0.f), F(0.f), F(0.f)};
        each<kAllShapes>(row, [&](auto shape, M m) VR_INLINED {
            if (none(m)) return;
            const LightEmission<L> one = shape.emit(row, r);
            e.p = select(m, one.p, e.p);
            e.d = select(m, one.d, e.d);
            e.radiance = select(m, one.radiance, e.radiance);
            e.cosine = select(m, one.cosine, e.cosine);
            e.pdf_area = select(m, one.pdf_area, e.pdf_area);
            e.pdf_sa = select(m, one.pdf_sa, e.pdf_sa);
        });
        return e;
    }
};

}  // namespace veriray
