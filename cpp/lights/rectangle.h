// Rectangles near to what they light, by solid angle where that is large: the map of C. Urena, M.
// Fajardo, A. King, "An Area-Preserving Parametrization for Spherical Rectangles", CGF 32(4), 2013,
// turned round in another way.
#pragma once

#include "core/math.h"
#include "lights/flat.h"

namespace veriray {

// The smallest solid angle to sample by. Below it, sampling by area is as good, and the rounding of
// the solid angle, 4e-7 at most, would show.
inline constexpr float kLeastSolidAngle = 0x1p-4f;

// Numbers from the host: 1 / |e1|, 1 / |e2|, |e2| / |e1|, 1 / area.
inline constexpr uint32_t kRectangleFloats = 4;
inline constexpr uint32_t kRectangleUnit = kLightOther + 1;
static_assert(kRectangleUnit + kRectangleFloats <= kLightColumns);

// A rectangle seen from p, with axes along its edges and in units of the first: x from x0 to
// x0 + 1, y from y0 to y1, at height z above p, which is positive in front.
template <class F>
struct RectangleView {
    using M = decltype(F() < F());
    F x0, y0, y1, z;
    F height, first, solid_angle, inverse_area;

    // `to`: from p to the corner that the edges e1 and e2 leave.
    VR_HD RectangleView(const F* shape, Vec3<F> to, Vec3<F> e1, Vec3<F> e2, Vec3<F> n) {
        const F unit = shape[0];
        x0 = dot(to, e1) * unit * unit;
        y0 = dot(to, e2) * shape[1] * unit;
        z = -dot(to, n) * unit;
        height = shape[2];
        y1 = y0 + height;
        inverse_area = shape[3];
        first = strip(x0, y0, y1, z);
        solid_angle = strip(x0 + F(1.f), y0, y1, z) - first;
    }

    // At distances whose fourth powers overflow, solid_angle is 0 or NaN.
    VR_HD M by_angle() const { return solid_angle >= F(kLeastSolidAngle); }
    VR_HD F share() const { return solid_angle * inverse_area; }  // of the area

    // Signed solid angle of the strip between 0 and x: the difference of two angles, asin(s b1) and
    // asin(s b0), with s = x / sqrt(x^2 + z^2) and b = y / sqrt(y^2 + z^2).
    static VR_ONCE F strip(F x, F y0, F y1, F z) {
        const F zz = z * z, square = fma(x, x, zz);
        const F r0 = sqrt(fma(y0, y0, square)), r1 = sqrt(fma(y1, y1, square));
        return angle(fma(x * x, y0 * y1, zz * r0 * r1), x * z * fma(y1, r0, -(y0 * r1)));
    }

    // A point a e1 + b e2, uniform in solid angle. strip(x) = w gives, by the sines of both angles:
    // s = sin w / sqrt(b0^2 + b1^2 - 2 b0 b1 cos w), and
    // x = z sin w / sqrt((cos w - b0 b1)^2 - (1 - b0^2) (1 - b1^2)).
    // y is then uniform in its sine. Rounding may put x or y beyond an edge. Close above the plane
    // and beside the rectangle it may do so by the rectangle's length, at a height of 1e-4 for 1e-4
    // of the points.
    VR_HD void sample(F u, F v, F& a, F& b) const {
        const F w = fma(u, solid_angle, first), zz = z * z, zero(0.f), one(1.f);
        F s, c;
        sincos_2pi(abs(w) * F(0.5f * kInvPi), s, c);
        const F q = one / sqrt(fma(y0, y0, zz) * fma(y1, y1, zz));
        const F k = c - y0 * y1 * q, g = zz * q;
        const F far = z * s / sqrt(max((k - g) * (k + g), zero));
        const F x = min(max(select(w < zero, -far, far), x0), x0 + one);
        const F square = fma(x, x, zz);
        const F h0 = y0 / sqrt(fma(y0, y0, square)), h1 = y1 / sqrt(fma(y1, y1, square));
        const F h = fma(v, h1 - h0, h0);
        const F y = min(max(h * sqrt(square / ((one - h) * (one + h))), y0), y1);
        a = x - x0;
        b = (y - y0) / height;
    }
};

template <class L>
struct RectangleLight : FlatLight<L, RectangleLight<L>> {
    VR_LIGHT_SHAPE(FlatLight<L, RectangleLight<L>>);
    static constexpr const char *kName = "rectangle", *kFeature = "rectangle_lights";
    static constexpr bool kByAngle = true, kPaired = true, kOwnPdf = true;

    template <class Row>
    static VR_HD RectangleView<F> view_of(const Row& row, V p) {
        F shape[kRectangleFloats];
        for (uint32_t k = 0; k < kRectangleFloats; ++k) shape[k] = row(kRectangleUnit + k);
        return {shape, row.vector(kLightP) - p, row.vector(kLightE1), row.vector(kLightE2),
                row.vector(kLightN)};
    }

    template <class Row>
    static VR_HD void place(const Row& row, V p, F u, F v, M lanes, FlatPlace<L>& at) {
        const RectangleView<F> view = view_of(row, p);
        at.by_angle = lanes & view.by_angle();
        if (any(at.by_angle)) {
            F a, b;
            view.sample(u, v, a, b);
            at.u = select(at.by_angle, a, at.u);
            at.v = select(at.by_angle, b, at.v);
            at.share = view.share();
        }
    }
    template <class Row>
    static VR_HD Pdf pdf_li(const Row& row, const Hit& at) {
        const RectangleView<F> view = view_of(row, at.from);
        const M by_angle = view.by_angle();
        const Pdf by_area = at.by_area();
        return {select(by_angle, F(1.f), by_area.over),
                select(by_angle, row(kLightInverse) * view.share(), by_area.under)};
    }
    template <class At>
    static void write(const LightSource& s, At at) {
        const auto length = [](Vec3<double> a) {
            return ieee_sqrt(a.x * a.x + a.y * a.y + a.z * a.z);
        };
        const double a = length(s.e1), b = length(s.e2);
        const double columns[kRectangleFloats] = {1 / a, 1 / b, b / a, 1 / s.area};
        Base::write(s, at);
        for (uint32_t k = 0; k < kRectangleFloats; ++k)
            at(kRectangleUnit + k) = static_cast<float>(columns[k]);
        at(kLightOther) = bit_cast<float>(s.other);
    }
};

}  // namespace veriray
