// The light table: what there is to sample, and with which probability.
#include <algorithm>

#include "scene/box_pairs.h"

namespace veriray {
namespace {

constexpr double kPiDouble = 3.14159265358979323846;
// The largest number of pairs of a point light and a primitive near it that are examined; beyond
// it, every light counts as within rounding of something.
constexpr size_t kMostPairs = size_t{1} << 24;

double sum3(const float* rgb) {
    return static_cast<double>(rgb[0]) + static_cast<double>(rgb[1]) + static_cast<double>(rgb[2]);
}

// Sine and cosine of an angle in degrees in [0, 180], by halving and Taylor series: the same on
// every machine.
void sin_cos_degrees(double degrees, double& s, double& c) {
    const double x = degrees * (kPiDouble / 180) / 16;
    double term = 1, sine = 0, cosine = 1;
    for (int n = 1; n < 20; n += 2) {
        term *= x / n;
        sine += term;
        term *= -x / (n + 1);
        cosine += term;
    }
    for (int k = 0; k < 4; ++k) {
        const double twice = 2 * sine * cosine;
        cosine = 1 - 2 * sine * sine;
        sine = twice;
    }
    s = sine, c = cosine;
}

}  // namespace

// Counts the leading quads that cannot block a shadow ray which begins in front of them: the light
// itself if it is the only one (a shadow ray ends before it), and quads that have the lights in
// front of them by more than the rounding of a shadow ray and its distance to the plane (2^-18).
// They must also have all else in front of them (to 2^-8), so that shadow rays begin there.
void HostScene::set_first_occluder() {
    const auto in_front = [&](const Flat& f, const Flat& other, double least) {
        const Double3 n = normalised(f.area_vector());
        for (uint32_t k = 0; k < other.corners; ++k)
            if (!(dot(n, other.v[k] - f.v[0]) >= least)) return false;
        return true;
    };
    uint32_t& first = view.first_occluder;
    for (; first < view.quad_count; ++first) {
        const Flat& f = flats_[first];
        if (f.emission >= 0 && view.lights.count == 1) continue;
        for (size_t i = 0; i < sources.size(); ++i)
            if (sources[i].emission >= 0 ? i >= flats_.size() || !in_front(f, flats_[i], 0x1p-16)
                                         : i < flats_.size() && !in_front(f, flats_[i], -0x1p-8))
                return;
    }
}

// A lower bound of the distance of a point from a primitive, by planes and boxes.
double HostScene::receiver_distance(const SceneInput& in, size_t primitive, Double3 p) const {
    const PrimitiveSource& s = sources[primitive];
    if (s.group == kSphereGroup) {
        const double* sphere = in.spheres.data + 4 * s.row;
        const Double3 c = (Double3{sphere[0], sphere[1], sphere[2]} - centre) * (1 / unit);
        return std::abs(length(p - c) - sphere[3] / unit);
    }
    const float* row = primitives.data() + primitive * view.primitive_row;
    const auto column = [&](uint32_t c) {
        return static_cast<double>(row[static_cast<size_t>(c) * view.primitive_column]);
    };
    double height = 0;
    for (int k = 0; k < 3; ++k) height += p[k] * column(kPrimN + static_cast<uint32_t>(k));
    height -= column(kPrimPlane);
    return std::max(std::sqrt(squared_gap({p, p}, box_around(in, primitive))), std::abs(height));
}

// The largest radiance that point lights and spots cause at a receiver, divided by 2^19; at least
// `least`. It follows from lower bounds of distances: from primitives; in media, 2^-14 of the
// shortest mean free path, within which 2^-14 of the singly scattered light is lost (SampleFault);
// and from the rounding of points. Only primitives near enough to exceed `least` are examined.
float HostScene::brightest_receiver(const SceneInput& in, const std::vector<uint32_t>& lights,
                                    float least) const {
    struct Lamp {
        Double3 p;
        double intensity, rounding, nearest;
    };
    double path = INFINITY;
    for (size_t k = 0; k < 3 * in.sigma_t.count; ++k)
        if (const double sigma = static_cast<double>(in.sigma_t.data[k]) * unit; sigma > 0)
            path = std::min(path, 0x1p-14 / sigma);
    float brightest = least;
    const auto add = [&](const Lamp& lamp) {
        const double near = unit * std::min(std::max(lamp.nearest, lamp.rounding), 1.0);
        const double most = lamp.intensity / (near * near) * 0x1p-19;
        brightest = std::max(brightest, static_cast<float>(most));
    };
    std::vector<Lamp> lamps;
    for (const uint32_t q : lights) {
        if (in.light_kind.data[q] == 2) continue;
        const Double3 p = (row3(in.light_position, q) - centre) * (1 / unit);
        const float* rgb = in.light_intensity.data + 3 * q;
        const double most = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)});
        lamps.push_back(
            {p, std::max({rgb[0], rgb[1], rgb[2]}), std::max(most * 0x1p-22, 0x1p-40), path});
        add(lamps.back());
    }
    // The distance from a lamp within which primitives matter; rounding is added.
    const double enough = std::max(static_cast<double>(brightest), 0x1p-101);
    const auto reach = [&](const Lamp& lamp) {
        return std::sqrt(lamp.intensity * 0x1p-19 / enough) / unit * (1 + 0x1p-20);
    };
    std::erase_if(lamps, [&](const Lamp& lamp) { return reach(lamp) < lamp.rounding; });
    const auto around = [&](size_t q) {
        const double r = reach(lamps[q]) + 0x1p-20 * lamps[q].rounding + 0x1p-48;
        return Box{lamps[q].p - Double3{r, r, r}, lamps[q].p + Double3{r, r, r}};
    };
    std::atomic<size_t> pairs(0);
    const bool all = box_pairs(
        lamps.size(), around, sources.size(), [&](size_t i) { return box_around(in, i); },
        [&](size_t q, size_t i) {
            const double distance = receiver_distance(in, i, lamps[q].p);
            std::atomic_ref<double> nearest(lamps[q].nearest);
            for (double was = nearest; distance < was;)
                if (nearest.compare_exchange_weak(was, distance)) break;
            return ++pairs < kMostPairs;
        });
    for (Lamp& lamp : lamps) {
        if (!all) lamp.nearest = 0;
        add(lamp);
    }
    return brightest;
}

// Selection probabilities are in proportion to emitted power, in units of 2^-24, at least one each.
void HostScene::set_lights(const SceneInput& in) {
    const std::vector<AreaLight> lit = area_lights(in);
    std::vector<uint32_t> delta;
    for (uint32_t q = 0; q < in.light_kind.count; ++q)
        if (sum3(in.light_intensity.data + 3 * q) > 0) delta.push_back(q);
    LightView& l = view.lights;
    l.count = static_cast<uint32_t>(lit.size() + delta.size());
    l.stride = padded(l.count);
    light_table.assign(static_cast<size_t>(kLightColumns) * l.stride, 0.f);
    light_chance.assign(padded(sources.size()), 0.f);
    if (l.count >= 1u << 22) throw std::invalid_argument("more than 2^22 - 1 lights");

    const bool sky = sum3(in.environment.data) > 0;
    std::copy_n(in.environment.data, 3, l.environment);

    std::vector<double> power;
    for (const AreaLight& a : lit)
        power.push_back(kPiDouble * a.area *
                        sum3(in.emissions.data + 3 * sources[a.primitive].emission));
    for (const uint32_t q : delta) {
        const double intensity = sum3(in.light_intensity.data + 3 * q);
        double mean = -1;  // cosine, averaged over the angles of the linear falloff
        if (in.light_kind.data[q] == 1) {
            const double cutoff = in.light_angles.data[2 * q],
                         beam = in.light_angles.data[2 * q + 1];
            const double width = (cutoff - beam) * (kPiDouble / 180);
            double s, s2;
            sin_cos_degrees(cutoff, s, mean);
            if (width > 1e-6) {
                sin_cos_degrees(beam, s2, mean);
                mean = (s - s2) / width;
            }
        }
        const double solid_angle = 2 * kPiDouble * (1 - mean);
        power.push_back(in.light_kind.data[q] == 2 ? kPiDouble * intensity
                                                   : solid_angle * intensity / (unit * unit));
    }
    double total = 0, sum = 0;
    for (const double p : power) total += p;
    const uint32_t spare = (1u << 24) - l.count;
    light_cdf.assign(std::max<size_t>(1, l.count), 1u << 24);
    uint32_t before = 0;
    for (uint32_t k = 0; k < l.count; ++k) {
        sum += power[k];
        const uint32_t end =
            k + 1 == l.count ? 1u << 24 : k + 1 + static_cast<uint32_t>(sum / total * spare);
        light_cdf[k] = end;
        const double chance = (end - before) * 0x1p-24;
        before = end;
        if (k < lit.size())
            put_area_light(in, k, lit[k], chance);
        else
            put_delta_light(in, k, delta[k - lit.size()], chance);
    }
    l.top_step = 1;
    while (l.top_step * 2 <= l.count) l.top_step *= 2;
    l.table = light_table.data();
    l.cdf = light_cdf.data();
    view.light_chance = light_chance.data();
    if (view.features & kRectangleLights) {
        light_row.assign(padded(sources.size()), 0.f);
        for (size_t k = 0; k < lit.size(); ++k)
            light_row[lit[k].primitive] = light_row[lit[k].other] = static_cast<float>(k);
        view.light_row = light_row.data();
    }
    if (delta.empty()) set_first_occluder();
    view.features |= (l.count > 1 ? kManyLights : 0u) | (sky ? kEnvironment : 0u);

    // A delta light's radiance at a receiver has no bound. It counts as the radiance at a 64th of
    // the scene's size, or more, so that at the nearest receiver it is below the film's limit of
    // 2^20.
    float brightest =
        std::max({in.environment.data[0], in.environment.data[1], in.environment.data[2]});
    for (const AreaLight& a : lit)
        for (int k = 0; k < 3; ++k)
            brightest =
                std::max(brightest, in.emissions.data[3 * sources[a.primitive].emission + k]);
    for (const uint32_t q : delta)
        for (int k = 0; k < 3; ++k) {
            const double intensity = in.light_intensity.data[3 * q + k];
            const double far = in.light_kind.data[q] == 2 ? 1 : unit / 64;
            brightest = std::max(brightest, static_cast<float>(intensity / (far * far)));
        }
    brightest = brightest_receiver(in, delta, brightest);
    int exponent = 0;
    if (brightest > 0) std::frexp(brightest, &exponent);
    if (exponent < -100 || exponent > 100)
        throw std::invalid_argument("the largest radiance, " + number(brightest) +
                                    ", is outside [1e-30, 1e30]");
    view.emission_scale = std::ldexp(1.f, -exponent);
}

void HostScene::put_area_light(const SceneInput& in, size_t row, const AreaLight& light,
                               double chance) {
    const PrimitiveSource& source = sources[light.primitive];
    const auto at = [&](uint32_t c) -> float& {
        return light_table[static_cast<size_t>(c) * view.lights.stride + row];
    };
    const auto column_of = [&](uint32_t primitive, uint32_t c) {
        return primitives[static_cast<size_t>(primitive) * view.primitive_row +
                          static_cast<size_t>(c) * view.primitive_column];
    };
    const auto prim = [&](uint32_t c) { return column_of(light.primitive, c); };
    const auto shape = [&](LightShape s, uint32_t feature) {
        at(kLightShape) = static_cast<float>(s);
        view.features |= feature;
    };
    const bool sphere = source.group == kSphereGroup;
    const double area = sphere ? 1 : light.area;
    at(kLightInverse) = static_cast<float>(area / chance);
    for (const uint32_t p : {light.primitive, light.other}) {
        light_chance[p] = static_cast<float>(chance / area);
    }
    for (uint32_t k = 0; k < 3; ++k)
        at(kLightRadiance + k) = in.emissions.data[3 * source.emission + k];
    at(kLightPrimitive) = bit_cast<float>(light.primitive);
    if (sphere) {
        shape(LightShape::kSphere, kSphereLights);
        for (uint32_t k = 0; k < kSphereFloats; ++k) at(kLightP + k) = prim(k);
        const bool inside = prim(kPrimSide) < 0;
        at(kLightN) = inside && lets_through(in, kSphereGroup, source.row) ? -2.f : prim(kPrimSide);
        return;
    }
    Double3 p, e1, e2;
    if (source.group == kDiskGroup) {
        shape(LightShape::kDisk, kDiskLights);
        p = (row3(in.disks, 3 * source.row) - centre) * (1 / unit);
        e1 = row3(in.disks, 3 * source.row + 1) * (1 / unit);
        e2 = row3(in.disks, 3 * source.row + 2) * (1 / unit);
    } else {
        const Flat f = shape_of(in, light);
        p = f.v[0], e1 = f.v[1] - f.v[0], e2 = f.v[f.corners - 1] - f.v[0];
        if (f.corners == 3)
            shape(LightShape::kTriangle, kAreaLights | kTriangleLights);
        else
            shape(LightShape::kParallelogram, kAreaLights);
    }
    for (uint32_t k = 0; k < 3; ++k) {
        at(kLightP + k) = static_cast<float>(p[static_cast<int>(k)]);
        at(kLightE1 + k) = static_cast<float>(e1[static_cast<int>(k)]);
        at(kLightE2 + k) = static_cast<float>(e2[static_cast<int>(k)]);
        at(kLightN + k) = prim(kPrimN + k);
    }
    // If rays leave the face by a bound that depends on the point, the offset is the bound at the
    // face's corners.
    const Box box = around(box_around(in, light.primitive), box_around(in, light.other));
    const double most = terms(box, {prim(kPrimN), prim(kPrimN + 1), prim(kPrimN + 2)});
    const float offsets[2] = {prim(kPrimOffset), column_of(light.other, kPrimOffset)};
    at(kLightOffset) = std::max(offsets[0], offsets[1]);
    if (std::min(offsets[0], offsets[1]) < 0)
        at(kLightOffset) = static_cast<float>(most) * kLocalOffset;
    if (std::min(offsets[0], offsets[1]) <= kTouches) at(kLightOffset) *= -1;
    if (!light.rectangle) return;
    shape(LightShape::kRectangle, kRectangleLights);
    const double a = length(e1), b = length(e2);
    const double columns[kRectangleFloats] = {1 / a, 1 / b, b / a, 1 / area};
    for (uint32_t k = 0; k < kRectangleFloats; ++k)
        at(kRectangleUnit + k) = static_cast<float>(columns[k]);
    at(kRectangleOther) = bit_cast<float>(light.other);
}

void HostScene::put_delta_light(const SceneInput& in, size_t light, size_t row, double chance) {
    const auto at = [&](uint32_t c) -> float& {
        return light_table[static_cast<size_t>(c) * view.lights.stride + light];
    };
    const uint32_t kind = in.light_kind.data[row];
    const double scale = kind == 2 ? 1 : 1 / (unit * unit);
    const Double3 p = (row3(in.light_position, row) - centre) * (1 / unit);
    const Double3 d = kind ? normalised(row3(in.light_direction, row)) : Double3{0, 0, 1};
    for (int k = 0; k < 3; ++k) {
        if (kind != 2) at(kLightP + static_cast<uint32_t>(k)) = static_cast<float>(p[k]);
        at(kLightN + static_cast<uint32_t>(k)) = static_cast<float>(d[k]);
        at(kLightRadiance + static_cast<uint32_t>(k)) =
            static_cast<float>(in.light_intensity.data[3 * row + k] * scale);
    }
    static constexpr LightShape kShapes[3] = {LightShape::kPoint, LightShape::kSpot,
                                              LightShape::kDirectional};
    at(kLightShape) = static_cast<float>(kShapes[kind]);
    at(kLightInverse) = static_cast<float>(1 / chance);
    at(kLightPrimitive) = bit_cast<float>(~0u);
    view.features |= kDeltaLights;
    if (kind != 1) return;
    const double cutoff = in.light_angles.data[2 * row], beam = in.light_angles.data[2 * row + 1];
    at(kSpotCutoff) = static_cast<float>(cutoff * (kPiDouble / 180));
    const double width = (cutoff - beam) * (kPiDouble / 180);
    at(kSpotInverse) = static_cast<float>(width > 1e-9 ? 1 / width : 1e9);
}

}  // namespace veriray
