#include "scene/scene.h"

#include <algorithm>
#include <numeric>

namespace veriray {
namespace {

constexpr double kMinFlat = 0x1p-8;  // smallest edge or height for which kEdgeSlack is negligible

Double3 vertex(const SceneInput& in, uint32_t i) {
    return {in.vertices[3 * i], in.vertices[3 * i + 1], in.vertices[3 * i + 2]};
}

double rounded(double x) { return static_cast<double>(static_cast<float>(x)); }

std::string number(double x) {
    char text[32];
    snprintf(text, sizeof text, "%g", x);
    return text;
}

void check(const SceneInput& in) {
    const auto fail = [](const std::string& what, size_t i, const std::string& rest) {
        throw std::invalid_argument(what + "[" + std::to_string(i) + "] " + rest);
    };
    if (in.width == 0 || in.height == 0)
        throw std::invalid_argument("the film has no pixels: " + std::to_string(in.width) + " x " +
                                    std::to_string(in.height));
    for (size_t i = 0; i < 3 * in.vertex_count; ++i)
        if (!std::isfinite(in.vertices[i])) fail("vertices", i / 3, "is not finite");
    for (size_t i = 0; i < 3 * in.triangle_count; ++i)
        if (in.triangles[i] >= in.vertex_count)
            fail("triangles", i / 3,
                 "has vertex " + std::to_string(in.triangles[i]) + " of " +
                     std::to_string(in.vertex_count));
    for (size_t i = 0; i < in.triangle_count; ++i) {
        if (in.triangle_material[i] >= in.material_count)
            fail("triangle_material", i, "is not a material");
        if (in.triangle_emission[i] >= static_cast<int64_t>(in.emission_count))
            fail("triangle_emission", i, "is not an emission");
    }
    for (size_t i = 0; i < 3 * in.material_count; ++i)
        if (!(in.reflectance[i] >= 0 && in.reflectance[i] <= 1))
            fail("reflectance", i / 3, "holds " + number(in.reflectance[i]) + "; allowed: [0, 1]");
    for (size_t i = 0; i < 3 * in.emission_count; ++i)
        if (!(in.emissions[i] >= 0 && std::isfinite(in.emissions[i])))
            fail("emissions", i / 3,
                 "holds " + number(in.emissions[i]) + "; allowed: finite, >= 0");
    for (float e : in.environment)
        if (!(e >= 0 && std::isfinite(e)))
            throw std::invalid_argument("environment holds " + number(e) +
                                        "; allowed: finite, >= 0");
}

double power_weight(const float* rgb) {
    return static_cast<double>(rgb[0]) + static_cast<double>(rgb[1]) + static_cast<double>(rgb[2]);
}

uint32_t padded(size_t n) {
    return static_cast<uint32_t>(std::max<size_t>(32, (n + 15) / 16 * 16));
}

}  // namespace

HostScene::HostScene(const SceneInput& in) : view{}, width(in.width), height(in.height) {
    check(in);
    normalise(in);
    std::vector<Flat> prims = input_triangles(in);
    bool tree = true;
    if (prims.size() <= 2 * kMaxFlat) {
        std::vector<Flat> flats = merge_coplanar(prims);
        double smallest = INFINITY;
        for (const Flat& f : flats)
            for (uint32_t k = 0; k < f.corners; ++k) {
                const double edge = length(f.v[(k + 1) % f.corners] - f.v[k]);
                smallest = std::min({smallest, edge, 2 * length(f.area_vector()) / edge});
            }
        if (flats.size() <= kMaxFlat && smallest >= kMinFlat) {
            std::stable_partition(flats.begin(), flats.end(),
                                  [](const Flat& f) { return f.parallelogram; });
            prims = flats;
            tree = false;
        }
    }
    if (prims.empty()) tree = false;
    set_primitives(in, prims, tree);
    set_lights(in, prims);
    set_camera(in);
    set_filter(in);
}

void HostScene::normalise(const SceneInput& in) {
    const Double3 eye{in.to_world[3], in.to_world[7], in.to_world[11]};
    double lo[3] = {eye.x, eye.y, eye.z}, hi[3] = {eye.x, eye.y, eye.z};
    for (size_t i = 0; i < in.vertex_count; ++i)
        for (int k = 0; k < 3; ++k) {
            lo[k] = std::min(lo[k], in.vertices[3 * i + k]);
            hi[k] = std::max(hi[k], in.vertices[3 * i + k]);
        }
    centre = {(lo[0] + hi[0]) / 2, (lo[1] + hi[1]) / 2, (lo[2] + hi[2]) / 2};
    double half = 0;
    for (int k = 0; k < 3; ++k) half = std::max(half, (hi[k] - lo[k]) / 2);
    if (!std::isfinite(half)) throw std::invalid_argument("the scene's extent is not finite");
    unit = half > 0 ? std::ldexp(1.0, std::ilogb(half) + 1) : 1.0;
}

std::vector<Flat> HostScene::input_triangles(const SceneInput& in) {
    std::vector<Flat> out;
    out.reserve(in.triangle_count);
    for (size_t i = 0; i < in.triangle_count; ++i) {
        Flat f{};
        f.corners = 3;
        for (int k = 0; k < 3; ++k) {
            const Double3 p = (vertex(in, in.triangles[3 * i + k]) - centre) * (1.0 / unit);
            f.v[k] = {rounded(p.x), rounded(p.y), rounded(p.z)};
        }
        f.triangle = static_cast<uint32_t>(i);
        f.material = in.triangle_material[i];
        f.emission = in.triangle_emission[i];
        if (f.emission >= 0 && power_weight(in.emissions + 3 * f.emission) <= 0) f.emission = -1;
        if (length(f.area_vector()) > 0)
            out.push_back(f);
        else
            ++dropped;
    }
    return out;
}

void HostScene::set_primitives(const SceneInput& in, const std::vector<Flat>& prims, bool tree) {
    const size_t n = prims.size();
    view.primitive_count = static_cast<uint32_t>(n);
    view.primitive_stride = padded(n);
    primitives.assign(static_cast<size_t>(kPrimColumns) * view.primitive_stride, 0.f);
    light_pdf_area.assign(view.primitive_stride, 0.f);
    primitive_triangle.resize(n);
    const auto shared = tree ? std::vector<std::array<bool, 4>>() : shared_edges(prims);
    const auto put = [&](uint32_t column, size_t i, double x) {
        primitives[static_cast<size_t>(column) * view.primitive_stride + i] = static_cast<float>(x);
    };
    if (tree) triangles.resize(n * kTriangleFloats);
    std::vector<float> lo, hi;
    for (size_t i = 0; i < n; ++i) {
        const Flat& f = prims[i];
        primitive_triangle[i] = f.triangle;
        float record[kPolygonFloats];
        const std::array<bool, 4> none{false, false, false, false};
        const std::array<bool, 4>& slack = tree ? none : shared[i];
        write_polygon(f, slack, record);
        if (tree) {
            lo.insert(lo.end(), 3, INFINITY);
            hi.insert(hi.end(), 3, -INFINITY);
            for (int k = 0; k < 3; ++k)
                for (int a = 0; a < 3; ++a) {
                    const float c = static_cast<float>(f.v[k][a]);
                    lo[3 * i + a] = std::min(lo[3 * i + a], c);
                    hi[3 * i + a] = std::max(hi[3 * i + a], c);
                }
        } else if (f.parallelogram) {
            write_quad(f, slack, view.quads + kQuadFloats * view.quad_count++);
        } else {
            std::copy_n(record, kPolygonFloats,
                        view.polygons + kPolygonFloats * view.polygon_count++);
        }
        // Leaving the plane: 16 units of 2^-24 of the terms of n.p (a rounded point put back on the
        // plane, and the plane's distance seen from it), and corners that are off the plane.
        const Double3 nf{record[0], record[1], record[2]};
        double terms = 0, off = 0;
        for (uint32_t k = 0; k < f.corners; ++k) {
            terms = std::max(terms, std::abs(nf.x * f.v[k].x) + std::abs(nf.y * f.v[k].y) +
                                        std::abs(nf.z * f.v[k].z));
            off = std::max(off, std::abs(dot(nf, f.v[k]) + static_cast<double>(record[3])));
        }
        const Double3 e = f.v[1] - f.v[0];
        const Double3 s = normalised(e - nf * dot(nf, e));
        put(kPrimN, i, nf.x), put(kPrimN + 1, i, nf.y), put(kPrimN + 2, i, nf.z);
        put(kPrimPlane, i, -static_cast<double>(record[3]));
        put(kPrimS, i, s.x), put(kPrimS + 1, i, s.y), put(kPrimS + 2, i, s.z);
        double leave = 0x1p-20 * terms + off;
        for (const bool widened : slack)  // not under the rim of a widened neighbour
            if (widened) leave = std::max(leave, static_cast<double>(kEdgeSlack));
        put(kPrimOffset, i, leave);
    }
    if (tree) {
        bvh = build_bvh(lo, hi);
        for (size_t slot = 0; slot < n; ++slot) {  // stored in leaf order
            const Flat& f = prims[bvh.order[slot]];
            float* t = &triangles[slot * kTriangleFloats];
            for (int k = 0; k < 9; ++k) t[k] = static_cast<float>(f.v[k / 3][k % 3]);
            for (int k = 0; k < 4; ++k) {
                const float c = primitives[static_cast<size_t>(kPrimN + k) * view.primitive_stride +
                                           bvh.order[slot]];
                t[9 + k] = k < 3 ? c : -c;
            }
        }
        view.bvh = {bvh.nodes.data(), triangles.data(), bvh.order.data()};
    }

    // Surfaces: one a primitive in small scenes, else one a (material, emission) pair.
    std::vector<std::pair<uint32_t, int32_t>> rows;
    if (tree) surface_of.resize(n);
    for (size_t i = 0; i < n; ++i) {
        const std::pair<uint32_t, int32_t> key{prims[i].material, prims[i].emission};
        if (!tree || rows.empty() || rows.back() != key) {
            const auto at = tree ? std::find(rows.begin(), rows.end(), key) : rows.end();
            if (at != rows.end()) {
                surface_of[i] = static_cast<uint32_t>(at - rows.begin());
                continue;
            }
            rows.push_back(key);
        }
        if (tree) surface_of[i] = static_cast<uint32_t>(rows.size() - 1);
    }
    view.surface_count = static_cast<uint32_t>(rows.size());
    view.surface_stride = padded(rows.size());
    surfaces.assign(static_cast<size_t>(kSurfaceColumns) * view.surface_stride, 0.f);
    for (size_t r = 0; r < rows.size(); ++r) {
        const auto put_surface = [&](uint32_t c, float x) {
            surfaces[static_cast<size_t>(c) * view.surface_stride + r] = x;
        };
        for (uint32_t k = 0; k < 3; ++k) {
            put_surface(kSurfaceAlbedo + k, in.reflectance[3 * rows[r].first + k]);
            if (rows[r].second >= 0)
                put_surface(kSurfaceRadiance + k, in.emissions[3 * rows[r].second + k]);
        }
        put_surface(kSurfaceTwoSided, in.two_sided[rows[r].first] ? 1.f : 0.f);
    }
    view.primitives = primitives.data();
    view.light_pdf_area = light_pdf_area.data();
    view.surface_of = tree ? surface_of.data() : nullptr;
    view.surfaces = surfaces.data();
    view.features = (view.quad_count ? kQuads : 0u) | (view.polygon_count ? kPolygons : 0u) |
                    (tree ? kBvh : 0u);
}

void HostScene::set_lights(const SceneInput& in, const std::vector<Flat>& prims) {
    std::vector<uint32_t> lit;
    for (uint32_t i = 0; i < prims.size(); ++i)
        if (prims[i].emission >= 0) lit.push_back(i);
    LightView& l = view.lights;
    l.count = static_cast<uint32_t>(lit.size());
    l.stride = padded(lit.size());
    light_table.assign(static_cast<size_t>(kLightColumns) * l.stride, 0.f);
    if (lit.size() >= 1u << 22)
        throw std::invalid_argument("more than 2^22 - 1 emitting triangles");

    const bool sky = power_weight(in.environment) > 0;
    std::copy_n(in.environment, 3, l.environment);
    l.environment_share = sky ? (lit.empty() ? 1u << 24 : 1u << 23) : 0u;

    // Choice in proportion to area times radiance, in units of 2^-24, at least one each.
    double total = 0;
    std::vector<double> weight(lit.size());
    for (size_t k = 0; k < lit.size(); ++k) {
        const Flat& f = prims[lit[k]];
        weight[k] = length(f.area_vector()) * power_weight(in.emissions + 3 * f.emission);
        total += weight[k];
    }
    const uint32_t units = (1u << 24) - l.environment_share;
    const uint32_t spare = units - l.count;
    light_cdf.assign(std::max<size_t>(1, lit.size()), 1u << 24);
    double sum = 0;
    uint32_t before = l.environment_share;
    float brightest = std::max({in.environment[0], in.environment[1], in.environment[2]});
    for (size_t k = 0; k < lit.size(); ++k) {
        const Flat& f = prims[lit[k]];
        sum += weight[k];
        const uint32_t end = k + 1 == lit.size()
                                 ? 1u << 24
                                 : l.environment_share + static_cast<uint32_t>(k + 1) +
                                       static_cast<uint32_t>(sum / total * spare);
        light_cdf[k] = end;
        const double area = length(f.area_vector());
        const float pdf = static_cast<float>((end - before) * 0x1p-24 / area);
        before = end;
        light_pdf_area[lit[k]] = pdf;

        const auto put = [&](uint32_t c, double x) {
            light_table[static_cast<size_t>(c) * l.stride + k] = static_cast<float>(x);
        };
        const Double3 e1 = f.v[1] - f.v[0], e2 = f.v[f.corners - 1] - f.v[0];
        for (int a = 0; a < 3; ++a) {
            put(kLightP + a, f.v[0][a]);
            put(kLightE1 + a, e1[a]);
            put(kLightE2 + a, e2[a]);
            const auto prim_column = [&](uint32_t c) {
                return primitives[static_cast<size_t>(c) * view.primitive_stride + lit[k]];
            };
            put(kLightN + a, prim_column(kPrimN + a));
            put(kLightOffset, prim_column(kPrimOffset));
            put(kLightRadiance + a, in.emissions[3 * f.emission + a]);
            brightest = std::max(brightest, in.emissions[3 * f.emission + a]);
        }
        put(kLightTriangle, f.corners == 3);
        put(kLightPdfArea, pdf);
        if (f.corners == 3) view.features |= kTriangleLights;
    }
    l.top_step = 1;
    while (l.top_step * 2 <= l.count) l.top_step *= 2;
    l.table = light_table.data();
    l.cdf = light_cdf.data();
    view.features |= (lit.empty() ? 0u : kAreaLights) | (lit.size() > 1 ? kManyLights : 0u) |
                     (sky ? kEnvironment : 0u);
    int exponent = 0;
    if (brightest > 0) std::frexp(brightest, &exponent);
    if (exponent < -100 || exponent > 100)
        throw std::invalid_argument("the largest radiance, " + number(brightest) +
                                    ", is outside [1e-30, 1e30]");
    view.emission_scale = std::ldexp(1.f, -exponent);
}

void HostScene::set_camera(const SceneInput& in) {
    const double* m = in.to_world;
    const Double3 left{m[0], m[4], m[8]}, up{m[1], m[5], m[9]}, forward{m[2], m[6], m[10]};
    const Double3 eye = (Double3{m[3], m[7], m[11]} - centre) * (1.0 / unit);
    // Film position (u, v) in [0, 1]^2 looks along left tx (1 - 2 (u + px)) + up ty (1 - 2 (v +
    // py))
    // + forward.
    const Double3 corner = left * (in.tan_half_x * (1 - 2 * in.principal_x)) +
                           up * (in.tan_half_y * (1 - 2 * in.principal_y)) + forward;
    const Double3 right = left * (-2 * in.tan_half_x / in.width);
    const Double3 down = up * (-2 * in.tan_half_y / in.height);
    CameraView& c = view.camera;
    for (int k = 0; k < 3; ++k) {
        c.origin[k] = static_cast<float>(eye[k]);
        c.corner[k] = static_cast<float>(corner[k]);
        c.right[k] = static_cast<float>(right[k]);
        c.down[k] = static_cast<float>(down[k]);
        c.forward[k] = static_cast<float>(forward[k]);
    }
    // Clipping that cuts nothing costs nothing: the scene's corners lie between the planes.
    double nearest = INFINITY, farthest = -INFINITY;
    for (size_t i = 0; i < in.vertex_count; ++i) {
        const double z =
            dot(vertex(in, static_cast<uint32_t>(i)) - Double3{m[3], m[7], m[11]}, forward);
        nearest = std::min(nearest, z);
        farthest = std::max(farthest, z);
    }
    const bool cuts_near = in.near_clip > 0 && !(nearest > in.near_clip * (1 + 1e-6));
    const bool cuts_far = !(farthest < in.far_clip * (1 - 1e-6));
    c.near_clip = cuts_near ? static_cast<float>(in.near_clip / unit) : 0.f;
    c.far_clip = cuts_far ? static_cast<float>(in.far_clip / unit) : INFINITY;
    if (cuts_near || cuts_far) view.features |= kClip;
}

namespace {
// e^-x for 0 <= x <= 8 in IEEE operations: Taylor of e^-(x/16), fourth power of two squared.
double exp_minus(double x) {
    const double y = -x / 16;
    double sum = 1, term = 1;
    for (int k = 1; k < 20; ++k) sum += term *= y / k;
    for (int k = 0; k < 4; ++k) sum *= sum;
    return sum;
}
}  // namespace

void HostScene::set_filter(const SceneInput& in) {
    FilterView& f = view.filter;
    filter_edges.assign(kFilterTable + 1, 0.f);
    f.radius = 0.5f;
    if (in.filter == "box") {
        f.kind = FilterKind::kBox;
    } else if (in.filter == "tent") {
        f.kind = FilterKind::kTent;
        f.radius = static_cast<float>(in.filter_parameter);
    } else if (in.filter == "gaussian") {
        // exp(-x^2 / 2 s^2) - exp(-8) on |x| < 4 s, as Mitsuba's: edges of cells of equal
        // probability.
        f.kind = FilterKind::kTable;
        constexpr int kSteps = 1 << 16;
        std::vector<double> cdf(kSteps + 1, 0.0);
        const auto density = [](double z) { return exp_minus(z * z / 2) - exp_minus(8); };
        for (int i = 0; i < kSteps; ++i) {
            const double z = -4 + 8.0 * (i + 0.5) / kSteps;
            cdf[i + 1] = cdf[i] + density(z);
        }
        int i = 0;
        for (uint32_t e = 0; e <= kFilterTable; ++e) {
            const double want = cdf[kSteps] * e / kFilterTable;
            while (i + 1 < kSteps && cdf[i + 1] < want) ++i;
            const double z = -4 + 8.0 * (i + (want - cdf[i]) / (cdf[i + 1] - cdf[i])) / kSteps;
            filter_edges[e] = static_cast<float>(z * in.filter_parameter);
        }
    } else {
        throw std::invalid_argument("filter '" + in.filter + "'; allowed: box, tent, gaussian");
    }
    f.edges = filter_edges.data();
}

size_t HostScene::memory() const {
    return sizeof(SceneView) +
           4 * (primitives.size() + light_pdf_area.size() + surfaces.size() + triangles.size() +
                light_table.size() + filter_edges.size() + surface_of.size() + light_cdf.size() +
                bvh.order.size()) +
           sizeof(BvhNode) * bvh.nodes.size();
}

}  // namespace veriray
