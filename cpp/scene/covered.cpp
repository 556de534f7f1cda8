// Flat lamps that something opaque covers so closely that shadow rays would end before it.
#include "scene/box_pairs.h"

namespace veriray {
namespace {

// A shadow ray ends before its lamp by the lamp's offset, 2^-20 at most, and by 2^-21 of its
// length, which is below 4. The latter, with the rounding of lengths (6 units of 2^-24), is less
// than kShortened of it.
constexpr double kNear = 0x1p-18, kShortened = 0x1p-20;
// Within this, the rounding of two corners, equal planes count as one, of which the first primitive
// is met. Of others as close as the rounding of planes either may be met: rays tell which.
constexpr double kOnePlane = 0x1p-23, kRounding = 0x1p-22;
// The share of a lamp that may be covered and is sampled all the same: neighbours whose edges
// differ by rounding overlap. So much of its light may come through the cover.
constexpr double kSliver = 1e-6;
// Of more primitives it is not asked which of them can see a lamp.
constexpr size_t kManyReceivers = 1 << 14;
// Of a polygon around a disk, over the disk's: corners are at most 1/16 rad apart.
constexpr double kAround = 1 + 0x1p-10;

Double3 area_vector(const Polygon& p) {
    Double3 sum{};
    for (size_t i = 1; i + 1 < p.size(); ++i) sum = sum + cross(p[i] - p[0], p[i + 1] - p[0]) * 0.5;
    return sum;
}

// The share of a polygon that another one of its plane covers; n: the plane's normal.
double covered_share(const Polygon& a, const Polygon& b, Double3 n) {
    return std::abs(dot(n, area_vector(common_part(a, b, n)))) / length(area_vector(a));
}

}  // namespace

Polygon common_part(const Polygon& a, const Polygon& b, Double3 n) {
    Polygon rest = a, kept;
    const double turn = dot(area_vector(b), n) < 0 ? -1 : 1;
    for (size_t k = 0; k < b.size() && !rest.empty(); ++k) {
        const Double3 p = b[k], inward = cross(n, b[(k + 1) % b.size()] - p) * turn;
        kept.clear();
        for (size_t i = 0; i < rest.size(); ++i) {
            const Double3 from = rest[i], to = rest[(i + 1) % rest.size()];
            const double x = dot(inward, from - p), y = dot(inward, to - p);
            if (x >= 0) kept.push_back(from);
            if ((x >= 0) != (y >= 0)) kept.push_back(from + (to - from) * (x / (x - y)));
        }
        rest.swap(kept);
    }
    return rest;
}

// The corners of a flat primitive, or of two that make a lamp; of a disk those of a polygon around
// it. Empty for a sphere.
std::vector<Double3> HostScene::outline(const SceneInput& in, const AreaLight& flat) const {
    const PrimitiveSource& source = sources[flat.primitive];
    if (source.group == kSphereGroup) return {};
    Polygon corners;
    if (source.group == kTriangleGroup) {
        const Flat f = shape_of(in, flat);
        corners.assign(f.v.begin(), f.v.begin() + f.corners);
        return corners;
    }
    const auto row = [&](size_t k) { return row3(in.disks, 3 * source.row + k) * (1 / unit); };
    const Double3 middle = row(0) - centre * (1 / unit), a = row(1), b = row(2);
    constexpr int kHalf = 64;  // corners of a half, by the tangent of half the angle
    for (int k = 0; k < 2 * kHalf; ++k) {
        const double t = 2. * (k % kHalf) / kHalf - 1, far = k < kHalf ? kAround : -kAround;
        corners.push_back(middle + (a * (1 - t * t) + b * (2 * t)) * (far / (1 + t * t)));
    }
    return corners;
}

// Whether two primitives are opaque, and a sheet with these sides does not look alike from both.
bool HostScene::sides_differ(const SceneInput& in, const PrimitiveSource& a,
                             const PrimitiveSource& b) const {
    const bool alike = a.material == b.material && a.emission < 0 && b.emission < 0 &&
                       in.sees_both_sides(a.material);
    return !alike && !lets_through(in, a.group, a.row) && !lets_through(in, b.group, b.row);
}

// Whether two opaque flat primitives are the sides of a sheet: of one outline, or with three
// corners in common (triangles of a sheet may be merged otherwise on its other side), in one plane
// up to twice kPlaneSlack, and facing away from each other. A sheet that looks alike from both
// sides is left out.
bool HostScene::back_to_back(const SceneInput& in, uint32_t a, uint32_t b) const {
    constexpr double kLeastShare = 1 - 0x1p-8;  // polygons around equal disks differ by 2^-10
    constexpr double kNoGap = 2 * static_cast<double>(kPlaneSlack);
    const PrimitiveSource &one = sources[a], &two = sources[b];
    if (a == b || one.group != two.group || !sides_differ(in, one, two)) return false;
    const Polygon p = outline(in, {a, a, false, 0}), q = outline(in, {b, b, false, 0});
    if (p.empty() || q.empty()) return false;
    const Double3 n = normalised(area_vector(p)), m = normalised(area_vector(q));
    if (dot(n, m) >= 0) return false;
    for (const Double3 corner : q)
        if (std::abs(dot(n, corner - p[0])) > kNoGap) return false;
    const auto shared = std::count_if(q.begin(), q.end(), [&](Double3 corner) {
        return std::any_of(p.begin(), p.end(),
                           [&](Double3 other) { return length(corner - other) <= kNoGap; });
    });
    return shared >= 3 ||
           (covered_share(p, q, n) > kLeastShare && covered_share(q, p, m) > kLeastShare);
}

// The planes of faces lie kPlaneSlack behind their fronts, so of two faces back to back rays would
// meet the backs. The later one's plane is moved before its front, beyond the other's plane; paths
// leave it by more than that.
void HostScene::part_backs(const SceneInput& in) {
    for (uint32_t b = 1; b < view.first_sphere; ++b)
        for (uint32_t a = 0; a < b; ++a) {
            if (!back_to_back(in, a, b)) continue;
            plane_record(b)[3] = -column(b, kPrimPlane) - 3 * kPlaneSlack;
            column(b, kPrimOffset) = kEdgeSlack;
            break;
        }
}

// Whether shadow rays from somewhere may end before a cover `gap` from a lamp of normal n, both in
// the box `pair`, whose coordinates bound the rounding of their planes. A ray across the cover ends
// as far from the lamp's plane as the lamp's offset and the shortened share of its start's height
// over that plane, so the heights of what can see the lamp decide. Of a fog without an end they
// have no bound. Lamps beside flat faces without a tree are hundreds of times kNear wide (kMinFlat,
// kMinBesideLocal): rays find them all the same.
bool HostScene::ends_before(const SceneInput& in, const AreaLight& light, Double3 n, double gap,
                            const Box& pair) const {
    if (!flats_.empty() || in.camera_medium >= 0) return gap <= kNear;
    const Box lamp = around(box_around(in, light.primitive), box_around(in, light.other));
    double size = 0;
    for (int k = 0; k < 3; ++k) size = std::max({size, -pair.low[k], pair.high[k]});
    const double offset = std::abs(lamp_offset(in, light)) + kRounding * size;
    const double most = (gap - offset) / kShortened;
    const double above = reach(lamp, n), below = reach(lamp, n * -1);
    const auto beyond = [&](const Box& b) {
        return std::max(reach(b, n) + below, reach(b, n * -1) + above) > most;
    };
    if (!beyond({{-1, -1, -1}, {1, 1, 1}})) return false;
    if (sources.size() > kManyReceivers) return true;
    const auto sees = [&](size_t i) {
        const Box box = box_around(in, i);
        if (!beyond(box)) return false;
        const AreaLight one{static_cast<uint32_t>(i), static_cast<uint32_t>(i), false, 0};
        const Polygon corners = outline(in, one);
        if (!corners.empty())
            return std::any_of(corners.begin(), corners.end(),
                               [&](Double3 p) { return beyond({p, p}); });
        // Of a ball the lamp sees from outside what lies no farther than along tangents.
        const Double3 c = (box.low + box.high) * 0.5;
        const double r2 = 0.25 * (box.high.x - box.low.x) * (box.high.x - box.low.x);
        double far2 = -r2;
        for (int k = 0; k < 3; ++k) {
            const double far = std::max(lamp.high[k] - c[k], c[k] - lamp.low[k]);
            far2 += far * far;
        }
        return lets_through(in, kSphereGroup, sources[i].row) || squared_gap({c, c}, lamp) < r2 ||
               far2 > most * most;
    };
    for (size_t i = 0; i < sources.size(); ++i)
        if (sees(i)) return true;
    return false;
}

std::vector<uint8_t> HostScene::covered(const SceneInput& in,
                                        const std::vector<AreaLight>& lights) const {
    std::vector<uint8_t> hidden(lights.size());
    const Double3 near{kNear, kNear, kNear};
    const auto around_lamp = [&](size_t k) {
        const Box box =
            around(box_around(in, lights[k].primitive), box_around(in, lights[k].other));
        return Box{box.low - near, box.high + near};
    };
    // Rays meet primitives of different rounded planes in either order: samples of a lamp would
    // count beside what they find instead of it.
    const auto one_plane = [&](uint32_t a, uint32_t b) {
        for (uint32_t c = kPrimN; c <= kPrimPlane; ++c)
            if (column(a, c) != column(b, c)) return false;
        return true;
    };
    const auto look = [&](size_t k, size_t i) {
        const AreaLight& light = lights[k];
        const std::atomic_ref<uint8_t> found(hidden[k]);
        const uint32_t cover = static_cast<uint32_t>(i);
        if (found || cover == light.primitive || cover == light.other ||
            lets_through(in, sources[i].group, sources[i].row))
            return true;
        if (records.empty() && back_to_back(in, light.primitive, cover)) return true;
        const Polygon lamp = outline(in, light), other = outline(in, {cover, cover, false, 0});
        if (lamp.empty() || other.empty()) return true;
        const Double3 n = normalised(area_vector(lamp)), m = normalised(area_vector(other));
        double high = 0, sum = 0;  // of the lamp over the other's plane
        for (const Double3 p : lamp) {
            const double height = dot(m, p - other[0]);
            high = std::max(high, std::abs(height)), sum += height;
        }
        const double size = static_cast<double>(lamp.size());
        const double before = -sum / size * (dot(m, n) < 0 ? -1 : 1);
        const bool same = one_plane(light.primitive, cover) || one_plane(light.other, cover);
        const bool first = same && std::abs(before) <= kOnePlane && light.primitive < cover &&
                           (sources[cover].group == kTriangleGroup ||
                            sources[light.primitive].group == kDiskGroup);
        if (high <= kNear && before >= -kRounding && !first &&
            covered_share(lamp, other, n) > kSliver &&
            ends_before(in, light, n, high, around(around_lamp(k), box_around(in, i))))
            found = 1;
        return true;
    };
    box_pairs(
        lights.size(), around_lamp, sources.size(), [&](size_t i) { return box_around(in, i); },
        look);
    return hidden;
}

// Those that are not covered stay in the list.
std::vector<AreaLight> HostScene::take_covered(const SceneInput& in,
                                               std::vector<AreaLight>& lights) {
    if (covered_.size() != lights.size()) covered_ = covered(in, lights);
    std::vector<AreaLight> seen, hidden;
    for (size_t k = 0; k < lights.size(); ++k) (covered_[k] ? hidden : seen).push_back(lights[k]);
    lights.swap(seen);
    return hidden;
}

}  // namespace veriray
