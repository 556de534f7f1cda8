// What small mirrors that absorb nothing lose of the light at a cosine: by Smith's shadows, and on
// the wrong side of the horizon.
#include "scene/lost_light.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "bsdfs/rough_coat.h"
#include "core/math.h"
#include "scene/thread_pool.h"

namespace veriray {
namespace {

constexpr double kRound = 3.14159265358979323846;

// Gauss and Legendre's nodes and weights on [0, 1].
struct Rule {
    std::vector<double> x, w;
    explicit Rule(int n) {
        for (int i = 0; i < n; ++i) {
            float sine, first;
            sincos_2pi(static_cast<float>(0.5 * (i + 0.75) / (n + 0.5)), sine, first);
            double z = double{first}, slope = 0;
            for (int step = 0; step < 8; ++step) {
                double p = 1, before = 0;
                for (int k = 0; k < n; ++k) {
                    const double last = before;
                    before = p;
                    p = ((2 * k + 1) * z * p - k * last) / (k + 1);
                }
                slope = n * (z * p - before) / (z * z - 1);
                z -= p / slope;
            }
            x.push_back(0.5 * (1 + z));
            w.push_back(1 / ((1 - z * z) * slope * slope));
        }
    }
};

// What goes through a smooth interface: the share, and the cosine beyond.
struct Split {
    double reflected, cos_t;
};
Split split(double c, double eta) {
    const double s2 = (1 - c * c) / (eta * eta);
    if (s2 >= 1) return {1, 0};
    const double t = std::sqrt(1 - s2);
    const double s = (c - eta * t) / (c + eta * t), p = (eta * c - t) / (eta * c + t);
    return {0.5 * (s * s + p * p), t};
}

double exponential(double x) { return double{exp_minus(static_cast<float>(x))}; }

struct Mirrors {
    double alpha;
    bool ggx, correlated;
    double eta;  // 0: they reflect all

    // As Microfacets::seen, of a direction with that sine and cosine.
    double seen(double sine, double c) const {
        const double s = alpha * sine;
        if (ggx) return 2 / (c + std::sqrt(c * c + s * s));
        if (c >= 1.6 * s) return 1 / c;
        return (3.535 * s + 2.181 * c) / (2.577 * c * c + 2.276 * s * c + s * s);
    }
    // The mean projected area of all mirrors on the side of a direction: c (1 + Lambda), of
    // Beckmann's by M. Abramowitz, I. A. Stegun, "Handbook of Mathematical Functions", 7.1.26.
    double area(double sine, double c) const {
        const double s = alpha * sine;
        if (ggx) return 0.5 * (c + std::sqrt(c * c + s * s));
        if (!(s > 0)) return c;
        const double a = c / s, t = 1 / (1 + 0.3275911 * a);
        const double erfc_over =
            t * (0.254829592 +
                 t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
        return c + exponential(a * a) * 0.5 * (s / std::sqrt(kRound) - c * erfc_over);
    }

    // G2 over that of wo alone, `masking`, for another direction's cosine.
    double unhidden(double masking, double cosine, bool through) const {
        const double sine = std::sqrt(std::max(1 - cosine * cosine, 0.));
        const double lit = seen(sine, cosine) * cosine;
        if (!correlated) return lit;
        if (!through) return lit / (masking + lit * (1 - masking));
        return lit * double{common_shadows(static_cast<float>(masking), static_cast<float>(lit))};
    }
    // What a mirror sends on to where it is seen; om: from wo to it, of length sqrt(m2).
    double sent(double c, double masking, double om, double m2, bool above) const {
        const double cosine = om / std::sqrt(m2);
        const Split light = eta > 0 ? split(std::min(cosine, 1.), eta) : Split{1, 0};
        double total = 0;
        if (const double up = 2 * om / m2 - c; above && up > 0)
            total += light.reflected * unhidden(masking, std::min(up, 1.), false);
        if (!(light.cos_t > 0)) return total;
        const double down = c / eta - (cosine / eta - light.cos_t) / std::sqrt(m2);
        if (down > 0) total += (1 - light.reflected) * unhidden(masking, std::min(down, 1.), true);
        return total;
    }

    // In polar coordinates of slopes (x, y) = alpha r (cos, sin): wo, of sine s and cosine c, sees
    // those for which c - s x > 0, of them mirrors reflect above the horizon where
    // c (x^2 + y^2) + 2 s x < c, a circle around 0. Angles are counted from a right one to wo, in
    // parts that end where total reflection is first met.
    double lost(double c, const Rule& rule) const {
        const double s = std::sqrt(1 - c * c), own = seen(s, c), right = 0.5 * kRound;
        const double first = eta > 0 ? 1 - eta * eta - c * c : 0;
        const double met_x = first > 0 ? std::min(std::sqrt(first) / s, 1.) : 0;
        const double met = std::min(double{angle(static_cast<float>(std::sqrt(1 - met_x * met_x)),
                                                 static_cast<float>(met_x))},
                                    right);
        double sum = 0;
        for (const double side : {-s, s})
            for (const auto& [from, to] : {std::array{0., met}, std::array{met, right}})
                for (size_t j = 0; j < rule.x.size() && to > from; ++j) {
                    const double v = rule.x[j], wide = to - from;
                    const double turn = from + wide * v * v * (3 - 2 * v);
                    float sine, cosine;
                    sincos_2pi(static_cast<float>(0.25 * turn / right), sine, cosine);
                    sum += rule.w[j] * wide * 6 * v * (1 - v) / right *
                           ray(c, own * c, side * double{sine}, rule);
                }
        return std::max(1 - own * area(s, c) + own * sum, 0.);
    }
    // Along a ray of slopes, x of whose tangent is towards wo. Places on it are r, the slopes over
    // alpha, for GGX 1 / sqrt(1 + r^2), in parts that end at the circle and where total reflection
    // begins.
    double ray(double c, double masking, double x, const Rule& rule) const {
        const double end = ggx ? 0 : 7, root = std::sqrt(x * x + c * c);
        const auto place_of = [&](double slope) {
            const double r = slope / alpha;
            return ggx ? 1 / std::sqrt(1 + r * r) : std::min(r, end);
        };
        const double edge = place_of(x > 0 ? c / (root + x) : (root - x) / c);
        const double limit = x > 0 ? place_of(c / x) : end;
        std::array<double, 5> ends{ggx ? 1. : 0., edge, limit, limit, limit};
        for (size_t k = 0; k < 2; ++k)
            if (const double slope = total_from(c, x)[k]; slope > 0 && slope * x < c)
                ends[3 + k] = place_of(slope);
        std::sort(ends.begin(), ends.end());
        double sum = 0;
        for (size_t part = 0; part + 1 < ends.size(); ++part) {
            const double wide = ends[part + 1] - ends[part];
            for (size_t i = 0; i < rule.x.size() && wide > 0; ++i) {
                const double u = rule.x[i], place = ends[part] + wide * u * u * (3 - 2 * u);
                const double r = ggx ? std::sqrt(1 - place * place) / place : place;
                const double density = ggx ? place : r * exponential(r * r);
                const double slope = alpha * r, om = c - slope * x;
                if (!(om > 0)) continue;
                const bool above = ggx ? place > edge : place < edge;
                const double kept = sent(c, masking, om, 1 + slope * slope, above);
                sum += rule.w[i] * wide * 6 * u * (1 - u) * density * om * (1 - kept);
            }
        }
        return sum;
    }
    // The slopes q along a ray at which (c - x q) / sqrt(1 + q^2) is the cosine of total
    // reflection.
    std::array<double, 2> total_from(double c, double x) const {
        const double c0 = 1 - eta * eta;  // squared
        if (!(eta > 0 && c0 > 0)) return {0, 0};
        const double a = x * x - c0, b = c * x, d = b * b - a * (c * c - c0);
        if (!(d > 0)) return {0, 0};
        const double q = b + (b < 0 ? -std::sqrt(d) : std::sqrt(d));
        return {q / a, (c * c - c0) / q};
    }
};

}  // namespace

LostLightTable lost_light(double alpha, bool ggx, bool correlated, double eta) {
    const Mirrors mirrors{alpha, ggx, correlated, eta};
    const Rule rule(eta > 0 ? 48 : 32), within(8);
    LostLightTable table{std::vector<float>(kLostCells + 1), 0};
    // at t = a / (a + b) of bsdfs/lost_light.h
    const auto cosine = [&](double t) {
        const double tangent = (1 - t) / t * ((1 - t) / t) / alpha;
        return 1 / std::sqrt(1 + tangent * tangent);
    };
    parallel(std::max(1u, std::thread::hardware_concurrency()), kLostCells + 1, {},
             [&](uint32_t, uint64_t k) {
                 // for a cosine of 0, near the limit
                 const double t = std::max(static_cast<double>(k), 1e-4) / kLostCells;
                 table.at_cosine[k] = static_cast<float>(mirrors.lost(cosine(t), rule));
             });
    for (uint32_t k = 0; k < kLostCells; ++k)
        for (size_t i = 0; i < within.x.size(); ++i) {
            const double x = within.x[i], t = (k + x) / kLostCells, c = cosine(t);
            const double slope = 2 * c * c * std::sqrt(1 - c * c) * (1 - t) / (alpha * t * t * t);
            const double low = double{table.at_cosine[k]}, high = double{table.at_cosine[k + 1]};
            table.mean += within.w[i] / kLostCells * 2 * c * slope * (low + x * (high - low));
        }
    return table;
}

double mean_reflectance(double eta, double k) {
    static const Rule rule(64);
    const double e2 = eta * eta, k2 = k * k;
    double sum = 0;
    for (size_t i = 0; i < rule.x.size(); ++i) {  // as fresnel_conductor
        const double c = rule.x[i], c2 = c * c, s2 = 1 - c2, d = e2 - k2 - s2;
        const double ab = std::sqrt(d * d + 4 * e2 * k2);
        const double t = 2 * std::sqrt(std::max(0.5 * (ab + d), 0.)) * c;
        const double s = (ab + c2 - t) / (ab + c2 + t);
        const double u = c2 * ab + s2 * s2, v = t * s2;
        sum += rule.w[i] * c * s * (1 + (u - v) / (u + v));
    }
    return sum;
}

double mean_reflectance(double eta) {
    static const Rule rule(64);
    double sum = 0;
    for (size_t i = 0; i < rule.x.size(); ++i)
        sum += rule.w[i] * 2 * rule.x[i] * split(rule.x[i], eta).reflected;
    return sum;
}

}  // namespace veriray
