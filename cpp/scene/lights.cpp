// The light table: what there is to sample, and with which probability.
#include <algorithm>

#include "bsdfs/kinds.h"
#include "scene/box_pairs.h"
#include "scene/light_texture.h"
#include "scene/light_tree.h"
#include "scene/sharp.h"
#include "scene/sky_guide.h"

namespace veriray {
namespace {

// Pairs of a point light and a primitive beside it that are looked at; beyond it, every light
// counts as within rounding of something.
constexpr size_t kMostPairs = size_t{1} << 24;

double sum3(const float* rgb) {
    return static_cast<double>(rgb[0]) + static_cast<double>(rgb[1]) + static_cast<double>(rgb[2]);
}

// Of n numbers, which are not negative.
float largest(const float* x, size_t n) {
    constexpr size_t kSides = 16;  // side by side
    float most[kSides] = {}, all = 0;
    size_t k = 0;
    for (; k + kSides <= n; k += kSides)
        for (size_t i = 0; i < kSides; ++i) most[i] = most[i] < x[k + i] ? x[k + i] : most[i];
    for (; k < n; ++k) all = std::max(all, x[k]);
    return std::max(all, *std::max_element(most, most + kSides));
}

}  // namespace

bool SceneInput::light_has_place(size_t q) const {
    return kLights[shape_of_kind(light_kind.data[q])].site == kAtPoint;
}

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
        if (light_chance[first] > kNotSampled && view.lights.count == 1) continue;
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
    double height = 0;
    for (uint32_t k = 0; k < 3; ++k)
        height += p[static_cast<int>(k)] * double{column(primitive, kPrimN + k)};
    height -= double{column(primitive, kPrimPlane)};
    return std::max(std::sqrt(squared_gap({p, p}, box_around(in, primitive))), std::abs(height));
}

// What a lamp that all but touches something counts as at most, in units of the largest radiance
// elsewhere: more, and the film would not resolve that. Next to no samples are refused for it.
constexpr float kMostNear = 0x1p36f;

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
    const double highest = static_cast<double>(least) * kMostNear;
    const auto add = [&](const Lamp& lamp) {
        const double near = unit * std::max(lamp.nearest, lamp.rounding);
        const double most = lamp.intensity / (near * near) * 0x1p-19;
        brightest = std::max(brightest, static_cast<float>(std::min(most, highest)));
    };
    std::vector<Lamp> lamps;
    for (const uint32_t q : lights) {
        if (!in.light_has_place(q)) continue;
        const Double3 p = (row3(in.light_position, q) - centre) * (1 / unit);
        const double most = std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)});
        lamps.push_back({p, most_intense(in, q), std::max(most * 0x1p-22, 0x1p-40), path});
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

// With mirrors of roughness alpha that is alpha^-2 / (4 pi cosine) straight back, and falls again
// for cosines below alpha: at most alpha^-3 / (4 pi). Refraction turns by a share of about |eta -
// 1| of what the mirror does, so what goes through is that much sharper.
bool any_sharp(const SceneInput& in) {
    constexpr float kAlpha = 0x1p-7f, kRoughness = 0.088f;  // its square is alpha
    for (size_t m = 0; m < in.material_kind.count; ++m) {
        const uint32_t kind = in.material_kind.data[m];
        if (!(kRoughKinds >> kind & 1u)) continue;
        const float turn = std::min(std::abs(in.eta.data[3 * m] - 1.f), 1.f);
        const float less = closure_traits(kind).transmits ? turn : 1.f;
        const auto below = [](float least, float number, int32_t texture) {
            return number < least || texture >= 0;
        };
        if (below(kAlpha, less * in.alpha_u.data[m], in.alpha_u_texture.data[m]) ||
            below(kAlpha, less * in.alpha_v.data[m], in.alpha_v_texture.data[m]) ||
            below(kRoughness, std::sqrt(less) * in.roughness.data[m], in.roughness_texture.data[m]))
            return true;
    }
    return false;
}

// The radiance that the film's resolution goes by; samples of 2^20 times as much are refused.
float HostScene::brightest_light(const SceneInput& in, const std::vector<AreaLight>& lamps,
                                 const std::vector<uint32_t>& lights) const {
    float brightest =
        std::max({in.environment.data[0], in.environment.data[1], in.environment.data[2]});
    brightest = std::max(brightest, largest(in.sky_texels.data, 3 * in.sky_texels.count));
    // A lamp counts as what it is a 64th of the scene's size away, at least as a share of its own
    // radiance that leaves room for where it is seen, and for the squares of that.
    std::vector<double> areas(in.emissions.count);  // normalised
    for (const AreaLight& a : lamps) areas[sources[a.primitive].emission] += a.area;
    for (size_t e = 0; e < areas.size(); ++e) {
        if (areas[e] == 0) continue;
        const float share = static_cast<float>(std::clamp(64. * 64 * areas[e], 0x1p-8, 1.)),
                    most = share * most_of_texture(in, in.emission_texture.data[e]);
        for (int k = 0; k < 3; ++k)
            brightest = std::max(brightest, in.emissions.data[3 * e + k] * most);
    }
    // A delta light's radiance at a receiver has no bound, as rough metals concentrate it. It
    // counts as 2^12 times that at the scene's size away, or at all that it can light if that is
    // farther; in media that is anywhere. Parallel light counts so where something is sharp.
    const double room = 1. / 64, parallel = any_sharp(in) ? room : 1;
    for (const uint32_t q : lights) {
        double far = parallel;
        if (in.light_has_place(q)) {
            const Double3 p = row3(in.light_position, q);
            far = unit;
            if (!in.sigma_t.count && extent.low.x <= extent.high.x)
                far = std::max(far, std::sqrt(squared_gap({p, p}, extent)));
            far *= room;
        }
        brightest = std::max(brightest, static_cast<float>(most_intense(in, q) / (far * far)));
    }
    return brightest_receiver(in, lights, brightest);
}

// The largest number that the radiance of a light with that texture is multiplied by.
float HostScene::most_of_texture(const SceneInput& in, int32_t texture) const {
    return texture < 0 ? 1.f : light_texture(in, texture).largest();
}
const LightTexture& HostScene::light_texture(const SceneInput& in, int32_t texture) const {
    std::shared_ptr<LightTexture>& known = light_textures_[texture];
    if (!known) known = std::make_shared<LightTexture>(in, static_cast<size_t>(texture));
    return *known;
}

// The largest intensity of a light without extent in any channel and direction.
double HostScene::most_intense(const SceneInput& in, size_t q) const {
    const float* rgb = in.light_intensity.data + 3 * q;
    double most = static_cast<double>(std::max({rgb[0], rgb[1], rgb[2]}) *
                                      most_of_texture(in, in.light_texture.data[q]));
    if (kLights[shape_of_kind(in.light_kind.data[q])].framed) {
        double square = 1;  // of the distance of the image's corners
        for (size_t k = 0; k < 2; ++k) {
            const Double3 a = row3(in.light_image, 2 * q + k);
            square += 0.25 / dot(a, a);
        }
        most *= square * std::sqrt(square);
    }
    return most;
}

// The mean of a lamp's texture over it.
double HostScene::mean_of_texture(const SceneInput& in, const AreaLight& light, int32_t t) const {
    const PrimitiveSource& source = sources[light.primitive];
    if (source.group != kTriangleGroup) return light_texture(in, t).mean(in);
    const Flat shape = shape_of(in, light);
    LitArea area;
    for (const uint32_t primitive : {light.primitive, light.other}) {
        area.triangles.push_back(sources[primitive].row);
        for (uint32_t k = 0; k < shape.corners; ++k) {
            const float* map = &uv[size_t{primitive} * kUvFloats];
            double at[2];
            for (int c = 0; c < 2; ++c) {
                const auto g = [&](int i) { return static_cast<double>(map[4 * c + i]); };
                at[c] = dot({g(0), g(1), g(2)}, shape.v[k]) + g(3);
            }
            area.corners.push_back({at[0], at[1], 0});
        }
    }
    return light_texture(in, t).mean(in, area);
}

void HostScene::set_lights(const SceneInput& in) {
    std::vector<AreaLight> lit = area_lights(in);
    // A light sample would reach these through what covers them; where they are seen all the same,
    // rays find them.
    const std::vector<AreaLight> found = take_covered(in, lit);
    std::vector<uint32_t> delta;
    for (uint32_t q = 0; q < in.light_kind.count; ++q)
        if (sum3(in.light_intensity.data + 3 * q) > 0) delta.push_back(q);
    LightView& l = view.lights;
    const LightSource sky = sky_source(in);
    const bool sky_sampled = sky.strength > 0 && kLights[sky.shape].sampled;
    l.count = static_cast<uint32_t>(lit.size() + delta.size() + sky_sampled);
    l.stride = padded(l.count);
    light_table.assign(static_cast<size_t>(kLightColumns) * l.stride, 0.f);
    light_chance.assign(padded(sources.size()), 0.f);
    if (l.count >= 1u << 22) throw std::invalid_argument("more than 2^22 - 1 lights");
    const auto source = [&](size_t k) {
        if (k == lit.size() + delta.size()) return sky;
        return k < lit.size() ? light_source(in, lit[k]) : light_source(in, delta[k - lit.size()]);
    };

    std::vector<double> power;
    std::vector<LightBound> bounds;
    for (uint32_t k = 0; k < l.count; ++k) {
        LightSource s = source(k);
        if (k < lit.size()) place_lamp(in, lit[k], s);
        put_light(s, light_table.data() + k, l.stride);
        with_shape(s.shape, [&](auto shape) {
            power.push_back(shape.power(s));
            bounds.push_back(shape.bound(s));
        });
    }
    for (const AreaLight& a : found) {
        view.features |= lights(shape_bit(light_source(in, a).shape));
        light_chance[a.primitive] = light_chance[a.other] = kNotSampled;
    }
    if (sky.strength > 0) put_light(sky, l.sky, 1);
    if (l.count > 1) {
        LightTreeTable tree = build_light_tree(bounds, power);
        for (uint32_t k = 0; k < l.count; ++k)
            light_table[size_t{kLightLeaf} * l.stride + k] = bit_cast<float>(tree.leaf[k]);
        if (sky_sampled) l.sky[kLightLeaf] = bit_cast<float>(tree.leaf[l.count - 1]);
        light_tree.assign(tree.branches.begin(), tree.branches.end());
        l.tree = {light_tree.data(), tree.root};
    }
    l.table = light_table.data();
    if (in.hides_light) {  // light_chance -1: a lamp too, which emits nothing
        for (size_t p = 0; p < sources.size(); ++p)
            if (in.emission(sources[p].group).data[sources[p].row] >= 0 && light_chance[p] == 0)
                light_chance[p] = -1;
        view.features |= kHidden;
    }
    view.light_chance = light_chance.data();
    if ((view.features & kOwnPdfLights) || l.count > 1) {
        light_row.assign(padded(sources.size()), 0.f);
        for (size_t k = 0; k < lit.size(); ++k)
            light_row[lit[k].primitive] = light_row[lit[k].other] = static_cast<float>(k);
        view.light_row = light_row.data();
    }
    if (delta.empty() && !sky_sampled) set_first_occluder();
    view.features |= only_if(l.count > 1, kManyLights);

    lit.insert(lit.end(), found.begin(), found.end());
    const float brightest = brightest_light(in, lit, delta);
    int exponent = 0;
    if (brightest > 0) std::frexp(brightest, &exponent);
    if (exponent < -100 || exponent > 100)
        throw std::invalid_argument("the largest radiance, " + number(brightest) +
                                    ", is outside [1e-30, 1e30]");
    view.emission_scale = std::ldexp(1.f, -exponent);
    view.muted_segments = in.muted_segments.data[0];
}

// A row of the light table, column c at row[c * stride], and what primitives know of it.
void HostScene::put_light(const LightSource& s, float* row, size_t stride) {
    const auto at = [&](uint32_t c) -> float& { return row[c * stride]; };
    const double per = kLights[s.shape].flat ? s.area : 1;
    at(kLightShape) = static_cast<float>(s.shape);
    at(kLightInverse) = static_cast<float>(per);
    at(kLightPrimitive) = bit_cast<float>(s.primitive);
    at(kLightTexture) = static_cast<float>(s.texture);
    for (uint32_t k = 0; k < 3 && !s.muted; ++k) at(kLightRadiance + k) = s.radiance[k];
    with_shape(s.shape, [&](auto shape) { shape.write(s, at); });
    view.features |= lights(shape_bit(s.shape));
    if (kLights[s.shape].site != kOnSurface) return;
    for (const uint32_t p : {s.primitive, s.other}) light_chance[p] = static_cast<float>(1 / per);
}

// What a lamp emits; place_lamp() gives the rest.
LightSource HostScene::light_source(const SceneInput& in, const AreaLight& light) const {
    const PrimitiveSource& source = sources[light.primitive];
    LightSource s{};
    s.texture = in.emission_texture.data[source.emission];
    s.shape = source.group == kSphereGroup                    ? kSphereLight
              : source.group == kDiskGroup                    ? kDiskLight
              : light.rectangle                               ? kRectangleLight
              : light.other != light.primitive                ? kTrianglePairLight
              : light_shape(in, light.primitive).corners == 3 ? kTriangleLight
                                                              : kParallelogramLight;
    s.area = light.area;
    std::copy_n(in.emissions.data + 3 * source.emission, 3, s.radiance);
    s.muted = in.emission_muted.data[source.emission];
    s.strength = sum3(s.radiance);
    if (s.texture >= 0) s.strength *= mean_of_texture(in, light, s.texture);
    s.primitive = light.primitive, s.other = light.other;
    return s;
}

// Of a flat lamp: how far light starts off it and shadow rays end before it. Of a face that is left
// by the point's own bound, the bound at its corners; negative if it touches what lets light
// through.
float HostScene::lamp_offset(const SceneInput& in, const AreaLight& light) const {
    const auto n = [&](uint32_t k) { return double{column(light.primitive, kPrimN + k)}; };
    const Box box = around(box_around(in, light.primitive), box_around(in, light.other));
    const float offsets[2] = {column(light.primitive, kPrimOffset),
                              column(light.other, kPrimOffset)};
    float offset = std::max(offsets[0], offsets[1]);
    if (std::min(offsets[0], offsets[1]) < 0)
        offset = static_cast<float>(terms(box, {n(0), n(1), n(2)})) * kLocalOffset;
    return std::min(offsets[0], offsets[1]) <= kTouches ? -offset : offset;
}

void HostScene::place_lamp(const SceneInput& in, const AreaLight& light, LightSource& s) const {
    const PrimitiveSource& source = sources[light.primitive];
    const auto prim = [&](uint32_t c) { return column(light.primitive, c); };
    if (source.group == kSphereGroup) {
        for (uint32_t k = 0; k < kSphereFloats; ++k) s.record[k] = prim(k);
        const bool inside = prim(kPrimSide) < 0;
        s.side = inside && lets_through(in, kSphereGroup, source.row) ? -2.f : prim(kPrimSide);
        return;
    }
    Double3 p, e1, e2;
    if (source.group == kDiskGroup) {
        p = (row3(in.disks, 3 * source.row) - centre) * (1 / unit);
        e1 = row3(in.disks, 3 * source.row + 1) * (1 / unit);
        e2 = row3(in.disks, 3 * source.row + 2) * (1 / unit);
    } else {
        const Flat f = shape_of(in, light);
        p = f.v[0], e1 = f.v[1] - f.v[0], e2 = f.v[f.corners - 1] - f.v[0];
        if (light.rectangle) {  // the rounding of corners shears the short edge
            Double3 &axis = dot(e1, e1) < dot(e2, e2) ? e2 : e1, &other = &axis == &e1 ? e2 : e1;
            other = other - axis * (dot(axis, other) / dot(axis, axis));
        }
    }
    s.p = {p.x, p.y, p.z}, s.e1 = {e1.x, e1.y, e1.z}, s.e2 = {e2.x, e2.y, e2.z};
    s.n = {prim(kPrimN), prim(kPrimN + 1), prim(kPrimN + 2)};
    s.offset = lamp_offset(in, light);
}

// A light that no ray meets.
LightSource HostScene::light_source(const SceneInput& in, uint32_t q) const {
    LightSource s{};
    s.texture = in.light_texture.data[q];
    s.shape = shape_of_kind(in.light_kind.data[q]);
    const double scale = in.light_has_place(q) ? 1 / (unit * unit) : 1;
    const float* intensity = in.light_intensity.data + 3 * q;
    for (int k = 0; k < 3; ++k) s.radiance[k] = static_cast<float>(intensity[k] * scale);
    s.muted = in.light_muted.data[q];
    s.strength = sum3(intensity) * scale;
    if (s.texture >= 0) s.strength *= light_texture(in, s.texture).mean(in);
    const Double3 p = (row3(in.light_position, q) - centre) * (1 / unit);
    const Double3 d =
        kLights[s.shape].aimed ? normalised(row3(in.light_direction, q)) : Double3{0, 0, 1};
    s.p = {p.x, p.y, p.z}, s.n = {d.x, d.y, d.z};
    const Double3 a = row3(in.light_image, 2 * q), b = row3(in.light_image, 2 * q + 1);
    s.image_u = {a.x, a.y, a.z}, s.image_v = {b.x, b.y, b.z};
    s.area = 1 / (length(a) * length(b));  // of a projector
    s.cutoff = in.light_angles.data[2 * q], s.beam = in.light_angles.data[2 * q + 1];
    return s;
}

LightSource HostScene::sky_source(const SceneInput& in) {
    LightSource s{};
    s.texture = -1;
    s.muted = in.sky_muted.data[0];
    const SkyImage image(in);
    if (!openings_)
        openings_ = std::make_shared<const SkyOpenings>(sky_openings(in, image, bounds_.get()));
    view.lights.map.guide = {};
    const bool guided = openings_->places() > 0;
    s.seen = openings_->share;
    if (in.sky_texels.count || guided) {
        s.shape = guided ? kGuidedSky : kImageSky;
        s.strength = set_sky_map(in, image);
        const auto axis = [&](int k) -> Vec3<double> {
            return {image.axes[k].x, image.axes[k].y, image.axes[k].z};
        };
        s.p = axis(0), s.e1 = axis(1), s.e2 = axis(2);
        return s;
    }
    s.shape = kConstantSky;
    std::copy_n(in.environment.data, 3, s.radiance);
    s.strength = sum3(s.radiance);
    return s;
}

}  // namespace veriray
