// Flat primitives of small scenes: merging of coplanar triangles, edge functions, shared edges.
#include <algorithm>

#include "scene/scene.h"

namespace veriray {
namespace {

bool same(Double3 a, Double3 b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

// Rounding a vertex to float32 moves it by at most 2^-25 per coordinate; four vertices take part.
constexpr double kFlatTolerance = 0x1p-22;

bool convex(const Flat& f) {
    const Double3 n = f.area_vector();
    for (uint32_t k = 0; k < 4; ++k) {
        const Double3 a = f.v[(k + 1) % 4] - f.v[k], b = f.v[(k + 2) % 4] - f.v[(k + 1) % 4];
        if (dot(cross(a, b), n) <= 1e-3 * length(a) * length(b) * length(n)) return false;
    }
    return true;
}

}  // namespace

Box box_of(const Flat& f) {
    Box box{f.v[0], f.v[0]};
    for (uint32_t k = 1; k < f.corners; ++k) {
        const Double3 p = f.v[k];
        box.low = {std::min(box.low.x, p.x), std::min(box.low.y, p.y), std::min(box.low.z, p.z)};
        box.high = {std::max(box.high.x, p.x), std::max(box.high.y, p.y),
                    std::max(box.high.z, p.z)};
    }
    return box;
}

double squared_gap(const Box& a, const Box& b) {
    double sum = 0;
    for (int k = 0; k < 3; ++k) {
        const double gap = std::max({b.low[k] - a.high[k], a.low[k] - b.high[k], 0.0});
        sum += gap * gap;
    }
    return sum;
}

double ellipse_reach(Double3 a, Double3 b, Double3 n) {
    const double u = dot(a, n), v = dot(b, n);
    return std::sqrt(u * u + v * v);
}
Double3 ellipse_reach(Double3 a, Double3 b) {
    return {ellipse_reach(a, b, {1, 0, 0}), ellipse_reach(a, b, {0, 1, 0}),
            ellipse_reach(a, b, {0, 0, 1})};
}

// The two share the edge a[i] -> a[i + 1], which runs backwards in b.
bool join_coplanar(const Flat& a, const Flat& b, Flat& out) {
    for (uint32_t i = 0; i < 3; ++i)
        for (uint32_t j = 0; j < 3; ++j) {
            if (!same(a.v[i], b.v[(j + 1) % 3]) || !same(a.v[(i + 1) % 3], b.v[j])) continue;
            out = a;
            out.v = {a.v[i], b.v[(j + 2) % 3], a.v[(i + 1) % 3], a.v[(i + 2) % 3]};
            out.corners = 4;
            out.triangle = std::min(a.triangle, b.triangle);
            const Double3 n = normalised(a.area_vector());
            if (std::abs(dot(n, b.v[(j + 2) % 3] - a.v[i])) > kFlatTolerance) return false;
            if (!convex(out)) return false;
            const Double3 gap = out.v[0] + out.v[2] - out.v[1] - out.v[3];
            out.parallelogram = length(gap) <= kFlatTolerance;
            return out.parallelogram || a.emission < 0;  // lights are sampled as parallelograms
        }
    return false;
}

std::vector<Flat> merge_coplanar(const std::vector<Flat>& triangles,
                                 const std::function<bool(const Flat&, const Flat&)>& matches) {
    std::vector<Flat> out;
    std::vector<bool> used(triangles.size(), false);
    for (size_t i = 0; i < triangles.size(); ++i) {
        if (used[i]) continue;
        Flat best = triangles[i];
        for (size_t j = i + 1; j < triangles.size(); ++j) {
            Flat joined;
            if (used[j] || triangles[j].material != triangles[i].material ||
                triangles[j].emission != triangles[i].emission ||
                triangles[j].boundary != triangles[i].boundary ||
                !join_coplanar(triangles[i], triangles[j], joined) ||
                !matches(triangles[i], triangles[j]))
                continue;
            best = joined;
            used[j] = true;
            break;
        }
        out.push_back(best);
    }
    return out;
}

std::vector<std::array<bool, 4>> shared_edges(const std::vector<Flat>& flats) {
    // Edges run along each other if both ends of the shorter lie on the longer, to rounding.
    const auto on = [](Double3 p, Double3 a, Double3 b) {
        const Double3 e = b - a;
        const double s = std::clamp(dot(p - a, e) / dot(e, e), 0.0, 1.0);
        return length(p - (a + e * s)) <= 4 * kFlatTolerance;
    };
    // Whether both faces extend from the edge in the same direction: then they lie on each other,
    // and no ray gets in between.
    const auto together = [&](const Flat& f, uint32_t k, const Flat& g, uint32_t m) {
        const auto inward = [](const Flat& h, uint32_t n) {
            return normalised(cross(h.area_vector(), h.v[(n + 1) % h.corners] - h.v[n]));
        };
        return dot(inward(f, k), inward(g, m)) > 1 - kFlatTolerance;
    };
    std::vector<std::array<bool, 4>> shared(flats.size(), {false, false, false, false});
    std::vector<Box> boxes;
    for (const Flat& f : flats) boxes.push_back(box_of(f));
    constexpr double kApart = 8 * kFlatTolerance;  // of boxes: no edges along each other
    for (size_t i = 0; i < flats.size(); ++i)
        for (uint32_t k = 0; k < flats[i].corners; ++k) {
            const Double3 a = flats[i].v[k], b = flats[i].v[(k + 1) % flats[i].corners];
            const Box edge = around({a, a}, {b, b});
            for (size_t j = 0; j < flats.size() && !shared[i][k]; ++j) {
                // A light keeps its area if the neighbour alone can close the gap.
                if (j == i || (flats[i].emission >= 0 && flats[j].emission < 0)) continue;
                if (squared_gap(edge, boxes[j]) > kApart * kApart) continue;
                for (uint32_t m = 0; m < flats[j].corners; ++m) {
                    const Double3 c = flats[j].v[m], d = flats[j].v[(m + 1) % flats[j].corners];
                    if (((on(a, c, d) && on(b, c, d)) || (on(c, a, b) && on(d, a, b))) &&
                        !together(flats[i], k, flats[j], m)) {
                        shared[i][k] = true;
                        break;
                    }
                }
            }
        }
    return shared;
}

bool rims_stick_out(const std::vector<Flat>& flats,
                    const std::vector<std::array<bool, 4>>& shared) {
    for (size_t i = 0; i < flats.size(); ++i) {
        if (shared[i] == std::array<bool, 4>{}) continue;
        const Double3 n = normalised(flats[i].area_vector());
        for (const Flat& f : flats)
            for (uint32_t k = 0; k < f.corners; ++k)
                if (dot(n, f.v[k] - flats[i].v[0]) < -4 * kFlatTolerance) return true;
    }
    return false;
}

void write_plane(const Flat& f, float* out) {
    const Double3 n = normalised(f.area_vector());
    const float nf[3] = {static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)};
    double offset = 0;
    for (uint32_t k = 0; k < f.corners; ++k)
        offset += (nf[0] * f.v[k].x + nf[1] * f.v[k].y + nf[2] * f.v[k].z) / f.corners;
    out[0] = nf[0], out[1] = nf[1], out[2] = nf[2], out[3] = static_cast<float>(-offset);
}

double plane_at_origin(const Flat& f) { return -dot(normalised(f.area_vector()), f.v[0]); }

namespace {
void write_edge(Double3 e, double w, float* out) {
    out[0] = static_cast<float>(e.x), out[1] = static_cast<float>(e.y),
    out[2] = static_cast<float>(e.z), out[3] = static_cast<float>(w);
}

// Inward unit normal of edge a -> b in the plane of normal n.
Double3 edge_normal(Double3 n, Double3 a, Double3 b) { return normalised(cross(n, b - a)); }
}  // namespace

void write_quad(const Flat& f, const std::array<bool, 4>& shared, float behind, float* out,
                std::array<float, 4>& rim) {
    write_plane(f, out);
    out[3] += behind;
    const Double3 n = normalised(f.area_vector());
    for (uint32_t k = 0; k < 2; ++k) {  // slab between the edges k and k + 2
        const Double3 e = edge_normal(n, f.v[k], f.v[k + 1]);
        const double half = 0.5 * dot(e, f.v[k + 2] - f.v[k]);
        const double slack = shared[k] || shared[k + 2] ? static_cast<double>(kEdgeSlack) : 0.0;
        const Double3 mid = (f.v[k] + f.v[k + 2]) * 0.5;
        const double scale = 1.0 / (half + slack);
        write_edge(e * scale, -dot(e, mid) * scale, out + 4 + 4 * k);
        rim[k] = static_cast<float>((half - slack) * scale);
    }
}

uint32_t write_short(const float* quad, float* out) {
    const float *plane = quad, *u = quad + 4, *v = quad + 8;
    for (uint32_t a = 0; a < 3; ++a) {
        const uint32_t b = a == 0 ? 1 : 0, c = a == 2 ? 1 : 2;
        if (plane[b] != 0 || plane[c] != 0 || std::abs(plane[a]) != 1) continue;
        if (u[a] != 0 || v[a] != 0) continue;
        *out++ = plane[3] * plane[a];
        for (const float* edge : {u, v}) *out++ = edge[3], *out++ = edge[b], *out++ = edge[c];
        return a;
    }
    for (uint32_t a = 0; a < 3; ++a) {
        const uint32_t b = a == 0 ? 1 : 0, c = a == 2 ? 1 : 2;
        if (u[a] == 0) std::swap(u, v);
        if (plane[a] != 0 || u[b] != 0 || u[c] != 0 || v[a] != 0) continue;
        *out++ = plane[b], *out++ = plane[c], *out++ = plane[3];
        *out++ = u[3], *out++ = u[a];
        *out++ = v[3], *out++ = v[b], *out++ = v[c];
        return kAlong + a;
    }
    return kAnyWay;
}

void write_polygon(const Flat& f, const std::array<bool, 4>& shared, float behind, float* out,
                   std::array<float, 4>& rim) {
    write_plane(f, out);
    out[3] += behind;
    const Double3 n = normalised(f.area_vector());
    for (uint32_t k = 0; k < 4; ++k) {
        if (k >= f.corners) {
            write_edge({0, 0, 0}, 1.0, out + 4 + 4 * k);
            continue;
        }
        const Double3 e = edge_normal(n, f.v[k], f.v[(k + 1) % f.corners]);
        const double slack = shared[k] ? static_cast<double>(kEdgeSlack) : 0.0;
        write_edge(e, slack - dot(e, f.v[k]), out + 4 + 4 * k);
        rim[k] = static_cast<float>(2 * slack);
    }
}

}  // namespace veriray
