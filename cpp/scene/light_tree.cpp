// Nodes are split like those of a tree of boxes, by flux, extent and spread of directions (A. Conty
// Estevez, C. Kulla 2018). A node is split in two, then the costlier half, and so on, until it has
// all its branches. Light from far away stands beside the others, at the root.
#include "scene/light_tree.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "scene/scene.h"

namespace veriray {
namespace {

constexpr uint32_t kInnerBranches = 8;  // of nodes below the root
constexpr uint32_t kFarBranches = 4;    // of the root
constexpr uint32_t kBins = 12;
constexpr double kLeastStrength = 0x1p-60;  // of the strongest light's

Double3 of(Vec3<double> a) { return {a.x, a.y, a.z}; }

struct Extent {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};

    void add(Double3 p, double r) {
        for (int k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], p[k] - r);
            high[k] = std::max(high[k], p[k] + r);
        }
    }
    void add(const Extent& e) {
        for (int k = 0; k < 3; ++k) {
            low[k] = std::min(low[k], e.low[k]);
            high[k] = std::max(high[k], e.high[k]);
        }
    }
    double width(int k) const { return high[k] - low[k]; }
    double square() const {  // of the diagonal
        double sum = 0;
        for (int k = 0; k < 3; ++k) sum += width(k) > 0 ? width(k) * width(k) : 0;
        return sum;
    }
    Double3 middle() const {
        return {0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2])};
    }
};

// What counts for a split of several lights.
struct Group {
    Extent places, axes;
    double flux = 0;
    bool around = false;  // some emit on all sides

    void add(const LightBound& light, double power) {
        places.add(of(light.p), light.radius);
        axes.add(of(light.axis), 0);
        flux += power;
        around |= light.wide <= -1;
    }
    void add(const Group& g) {
        places.add(g.places);
        axes.add(g.axes);
        flux += g.flux;
        around |= g.around;
    }
    // Flux times a squared length times a solid angle. An angle of axes x apart has 1 - cos =
    // x^2/2; lamps alike emit over pi, on all sides over 4 pi.
    double cost() const {
        const double spread = around ? 2 : std::min(2.0, 0.125 * axes.square());
        return flux * places.square() * (1 + 1.5 * spread);
    }
};

struct Range {
    uint32_t begin, end;
    double cost;
    uint32_t size() const { return end - begin; }
};

class Builder {
   public:
    Builder(const std::vector<LightBound>& lights, const std::vector<double>& power)
        : lights_(lights), power_(power), order_(lights.size()) {
        for (const LightBound& light : lights) most_ = std::max(most_, light.strength);
        int exponent = 0;
        std::frexp(most_, &exponent);
        scale_ = -exponent;
        table_.leaf.resize(lights.size());
        std::iota(order_.begin(), order_.end(), 0u);
        near_ = static_cast<uint32_t>(
            std::stable_partition(order_.begin(), order_.end(),
                                  [&](uint32_t k) { return lights_[k].radius >= 0; }) -
            order_.begin());
    }

    LightTreeTable build() {
        const uint32_t count = static_cast<uint32_t>(order_.size()), away = count - near_;
        std::vector<Range> root;
        if (away <= kFarBranches || count <= kMostBranches)
            for (uint32_t k = near_; k < count; ++k) root.push_back({k, k + 1, 0});
        else
            root.push_back({near_, count, 0});
        const uint32_t room = kMostBranches - static_cast<uint32_t>(root.size());
        if (near_ <= room)  // in their order, which rounding does not change
            for (uint32_t k = 0; k < near_; ++k) root.push_back({k, k + 1, 0});
        else
            split({0, near_, 0}, room, root);
        table_.root = static_cast<uint32_t>(root.size());
        put(root, ~0u);
        for (size_t b = 0; b < ranges_.size(); ++b) {
            if (ranges_[b].size() == 1) continue;
            std::vector<Range> inner;
            split(ranges_[b], kInnerBranches, inner);
            set(b, kBranchFirst, static_cast<uint32_t>(ranges_.size()));
            set(b, kBranchCount, static_cast<uint32_t>(inner.size()));
            put(inner, static_cast<uint32_t>(b));
        }
        for (size_t b = ranges_.size(); b-- > 0;) bound(static_cast<uint32_t>(b));
        return std::move(table_);
    }

   private:
    const std::vector<LightBound>& lights_;
    const std::vector<double>& power_;
    std::vector<uint32_t> order_;
    uint32_t near_ = 0;
    double most_ = 0;
    int scale_ = 0;
    LightTreeTable table_;
    std::vector<Range> ranges_;    // by branch
    std::vector<Extent> extents_;  // likewise

    float& at(size_t branch, uint32_t c) { return table_.branches[branch * kBranchFloats + c]; }
    double get(size_t branch, uint32_t c) { return static_cast<double>(at(branch, c)); }
    Double3 vector(size_t branch, uint32_t c) {
        return {get(branch, c), get(branch, c + 1), get(branch, c + 2)};
    }
    void set(size_t branch, uint32_t c, uint32_t bits) { at(branch, c) = bit_cast<float>(bits); }
    void put3(size_t branch, uint32_t c, Double3 v) {
        for (int k = 0; k < 3; ++k)
            at(branch, c + static_cast<uint32_t>(k)) = static_cast<float>(v[k]);
    }

    void put(const std::vector<Range>& ranges, uint32_t up) {
        ranges_.insert(ranges_.end(), ranges.begin(), ranges.end());
        table_.branches.resize(ranges_.size() * kBranchFloats, 0.f);
        extents_.resize(ranges_.size());
        for (size_t b = ranges_.size() - ranges.size(); b < ranges_.size(); ++b)
            set(b, kBranchUp, up);
    }

    Group group(uint32_t begin, uint32_t end) const {
        Group g;
        for (uint32_t k = begin; k < end; ++k) g.add(lights_[order_[k]], power_[order_[k]]);
        return g;
    }

    // The range in as many parts as it has lights, at most `most`.
    void split(const Range& whole, uint32_t most, std::vector<Range>& parts) {
        const size_t first = parts.size();
        parts.push_back(whole);
        while (parts.size() - first < most) {
            size_t worst = parts.size();
            for (size_t k = first; k < parts.size(); ++k)
                if (parts[k].size() > 1 &&
                    (worst == parts.size() || parts[k].cost > parts[worst].cost))
                    worst = k;
            if (worst == parts.size()) return;
            const Range old = parts[worst];
            uint32_t middle = old.begin + old.size() / 2;
            double costs[2] = {0, 0};
            if (old.begin < near_) middle = halve(old, costs);
            parts[worst] = {old.begin, middle, costs[0]};
            parts.push_back({middle, old.end, costs[1]});
        }
    }

    uint32_t halve(const Range& r, double costs[2]) {
        Extent centres;
        for (uint32_t k = r.begin; k < r.end; ++k) centres.add(of(lights_[order_[k]].p), 0);
        int longest = 0;
        for (int k = 1; k < 3; ++k)
            if (centres.width(k) > centres.width(longest)) longest = k;
        double best = INFINITY;
        int best_axis = -1;
        uint32_t best_bin = 0;
        const auto bin_of = [&](uint32_t light, int axis) {
            const double x = (of(lights_[light].p)[axis] - centres.low[axis]) / centres.width(axis);
            return std::min(static_cast<uint32_t>(x * kBins), kBins - 1);
        };
        for (int axis = 0; axis < 3; ++axis) {
            if (!(centres.width(axis) > 0) || (r.size() > kManyInRange && axis != longest))
                continue;
            Group bins[kBins];
            uint32_t sizes[kBins] = {};
            for (uint32_t k = r.begin; k < r.end; ++k) {
                const uint32_t light = order_[k], bin = bin_of(light, axis);
                bins[bin].add(lights_[light], power_[light]);
                ++sizes[bin];
            }
            double above[kBins] = {};
            Group g;
            for (uint32_t b = kBins - 1; b > 0; --b) {
                if (sizes[b]) g.add(bins[b]);
                above[b] = g.cost();
            }
            g = {};
            // Thin nodes are split along their length.
            const double thin = centres.width(longest) / centres.width(axis);
            uint32_t below = 0;
            for (uint32_t b = 0; b + 1 < kBins; ++b) {
                if (sizes[b]) g.add(bins[b]);
                below += sizes[b];
                const double cost = (g.cost() + above[b + 1]) * thin;
                if (below && below < r.size() && cost < best)
                    best = cost, best_axis = axis, best_bin = b;
            }
        }
        uint32_t middle = r.begin + r.size() / 2;
        if (best_axis >= 0)
            middle = static_cast<uint32_t>(
                std::stable_partition(
                    order_.begin() + r.begin, order_.begin() + r.end,
                    [&](uint32_t k) { return bin_of(k, best_axis) <= best_bin; }) -
                order_.begin());
        costs[0] = group(r.begin, middle).cost(), costs[1] = group(middle, r.end).cost();
        return middle;
    }
    static constexpr uint32_t kManyInRange = 1u << 16;

    // The cosine of the sum of two angles, or -1 from 180 degrees on; sines are not negative.
    static double cosine_sum(double a, double sine_a, double b, double sine_b) {
        return sine_a * b + a * sine_b < 0 ? -1 : a * b - sine_a * sine_b;
    }
    static double sine_of(double cosine) { return std::sqrt(std::max(0.0, 1 - cosine * cosine)); }

    // Those of its branches are known.
    void bound(uint32_t b) {
        if (ranges_[b].size() == 1) {
            const LightBound& light = lights_[order_[ranges_[b].begin]];
            table_.leaf[order_[ranges_[b].begin]] = b;
            set(b, kBranchFirst, order_[ranges_[b].begin]);
            set(b, kBranchCount, 0);
            put3(b, kBranchP, of(light.p));
            // Of what has an extent, with the rounding of its points.
            double radius = light.radius;
            if (radius > 0)
                for (int k = 0; k < 3; ++k)
                    radius = std::max(radius, light.radius + 0x1p-21 * std::abs(of(light.p)[k]));
            at(b, kBranchRadius) = static_cast<float>(radius > 0 ? radius * (1 + 0x1p-20) : radius);
            if (radius >= 0) extents_[b].add(vector(b, kBranchP), get(b, kBranchRadius));
            const double strength = most_ > 0 ? std::ldexp(light.strength, scale_) : 1;
            finish(b, of(light.axis), light.wide, light.edge, std::max(strength, kLeastStrength));
            return;
        }
        const uint32_t first = as_uint(at(b, kBranchFirst)), count = as_uint(at(b, kBranchCount));
        double strength = 0, edge = 1, wide = 1;
        Double3 axis{0, 0, 0};
        bool around = false;
        for (uint32_t c = first; c < first + count; ++c) {
            strength += get(c, kBranchStrength);
            edge = std::min(edge, 1 - 1 / get(c, kBranchInverse));
            axis = axis + vector(c, kBranchAxis) * get(c, kBranchStrength);
            around |= get(c, kBranchWide) <= -1;
            extents_[b].add(extents_[c]);
        }
        if (get(first, kBranchRadius) < 0) {
            at(b, kBranchRadius) = kFromAllAround;
            put3(b, kBranchP, {0, 0, 1});
            finish(b, {0, 0, 0}, -1, 0, strength);
            return;
        }
        put3(b, kBranchP, extents_[b].middle());
        const Double3 middle = vector(b, kBranchP);
        double radius = 0;
        for (uint32_t c = first; c < first + count; ++c)
            radius = std::max(radius, length(vector(c, kBranchP) - middle) + get(c, kBranchRadius));
        at(b, kBranchRadius) = static_cast<float>(radius * (1 + 0x1p-20));
        if (around || !(length(axis) > 0x1p-20 * strength)) {
            finish(b, {0, 0, 0}, -1, edge, strength);
            return;
        }
        axis = normalised(axis);
        for (uint32_t c = first; c < first + count; ++c) {
            const double cosine = std::clamp(dot(axis, vector(c, kBranchAxis)), -1.0, 1.0);
            wide = std::min(wide, cosine_sum(cosine, sine_of(cosine), get(c, kBranchWide),
                                             get(c, kBranchWideSine)));
        }
        finish(b, axis, wide, edge, strength);
    }

    void finish(uint32_t b, Double3 axis, double wide, double edge, double strength) {
        put3(b, kBranchAxis, axis);
        at(b, kBranchWide) = static_cast<float>(wide);
        at(b, kBranchWideSine) = static_cast<float>(sine_of(wide));
        at(b, kBranchStrength) = static_cast<float>(strength);
        const bool leaf = ranges_[b].size() == 1;
        if (leaf) edge -= static_cast<double>(kAngleSlack);
        at(b, kBranchEdge) = static_cast<float>(edge);
        at(b, kBranchInverse) = static_cast<float>(1 / (1 - edge));
    }
};

}  // namespace

LightTreeTable build_light_tree(const std::vector<LightBound>& lights,
                                const std::vector<double>& power) {
    return Builder(lights, power).build();
}

}  // namespace veriray
