// Balls that touch: those with almost one centre whose radii differ only by rounding.
#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <tuple>
#include <vector>

#include "scene/box_pairs.h"
#include "scene/touching.h"

namespace veriray {

// Of `fixed` spheres in one place, one of which shines, all but one shrink by apart(sphere): rays
// would find one or the other. The first is seen, from within if the first lamp shines there.
template <class Apart>
static void shrink_copies(const SceneInput& in, const std::vector<Box>& places,
                          const std::vector<bool>& fixed, Apart apart, std::vector<double>& radius,
                          std::vector<bool>& moves) {
    std::vector<std::array<double, 3>> place(places.size());  // the middle, rounded
    std::vector<uint32_t> order;
    for (uint32_t i = 0; i < places.size(); ++i) {
        const Double3 p = places[i].low * 0x1p24;
        place[i] = {std::round(p.x), std::round(p.y), std::round(p.z)};
        if (fixed[i]) order.push_back(i);
    }
    std::stable_sort(order.begin(), order.end(),
                     [&](uint32_t a, uint32_t b) { return place[a] < place[b]; });
    for (auto first = order.begin(), last = first; first != order.end(); first = last) {
        while (last != order.end() && place[*last] == place[*first]) ++last;
        const auto lamp =
            std::find_if(first, last, [&](uint32_t i) { return in.sphere_emission.data[i] >= 0; });
        if (last - first == 1 || lamp == last) continue;
        const int64_t side = in.sphere_inward.data[*lamp] ? -1 : 1;
        std::sort(first, last, [&](uint32_t a, uint32_t b) {  // from the outside in
            return std::tuple(-radius[a], side * a) < std::tuple(-radius[b], side * b);
        });
        for (auto i = first + 1; i != last; ++i) {
            const double around = radius[i[-1]], by = apart(*i);
            if (length(places[*i].low - places[i[-1]].low) > 0x1p-24 * radius[*i]) continue;
            if (around - radius[*i] >= by) continue;
            radius[*i] = std::max(around - by, 0.5 * radius[*i]);
            moves[*i] = true;
        }
    }
}

// Spheres with almost one centre whose radii differ only by rounding: those that let light through
// grow around one that does not, and shrink within any other. The order is that of the radii; of
// equal ones, an opaque body lies within the others, which lie within each other as they are given,
// and within what stays.
void HostScene::part_concentric(const SceneInput& in) {
    const auto number_of = [&](uint32_t i, int k) { return in.spheres.data[4 * size_t{i} + k]; };
    const uint32_t count = static_cast<uint32_t>(in.spheres.count);
    std::vector<double> radius(count);
    std::vector<Box> places(count);
    std::vector<uint32_t> clear;
    std::vector<bool> fixed(count), moves(count, false);
    for (uint32_t i = 0; i < count; ++i) {
        radius[i] = number_of(i, 3) / unit,
        places[i].low = places[i].high = ball_centre(in, i, centre, unit);
        const bool opaque = !lets_through(in, kSphereGroup, i);
        if (!opaque) clear.push_back(i);
        fixed[i] = opaque || in.sphere_emission.data[i] >= 0;
    }
    if (count < 2) return;
    const auto apart = [&](uint32_t i) {
        return kParted * (length(places[i].low) + radius[i] + std::min(0.5, 32 * 2 * radius[i]));
    };
    const auto to_lamp = [&](uint32_t i) {
        return in.sphere_emission.data[i] >= 0
                   ? static_cast<double>(kLocalOffset) * shadow_length(2 * radius[i], false)
                   : 0;
    };
    shrink_copies(in, places, fixed, apart, radius, moves);
    const auto rank = [&](uint32_t i) {  // of equal radii, from the inside out
        const bool body = fixed[i] && !lets_through(in, kSphereGroup, i) &&
                          !in.sphere_inward.data[i] &&
                          !in.sees_both_sides(in.material(kSphereGroup).data[i]);
        return body ? 0 : fixed[i] ? 2 : 1;
    };
    const auto within = [&](uint32_t a, uint32_t b) {  // a in b
        return std::tuple(number_of(a, 3), rank(a), b) < std::tuple(number_of(b, 3), rank(b), a);
    };
    struct Shells {
        uint32_t inner, outer;
        double want;
    };
    std::vector<Shells> shells;
    std::mutex mutex;
    box_pairs(
        clear.size(),
        [&](size_t k) {
            const double by = 2 * (apart(clear[k]) + to_lamp(clear[k]));
            return Box{places[clear[k]].low - Double3{by, by, by},
                       places[clear[k]].high + Double3{by, by, by}};
        },
        count, [&](size_t k) { return places[k]; },
        [&](size_t k, size_t other) {
            uint32_t a = clear[k], b = static_cast<uint32_t>(other);
            const double off = length(places[a].low - places[b].low);
            const double want = off + std::max(apart(a), apart(b)) + to_lamp(a) + to_lamp(b);
            if (a == b || std::abs(radius[a] - radius[b]) > 2 * want || off > 0.5 * want)
                return true;
            if (!within(a, b)) std::swap(a, b);
            const std::lock_guard lock(mutex);
            shells.push_back({a, b, want});
            return true;
        });
    std::sort(shells.begin(), shells.end(), [&](const Shells& a, const Shells& b) {
        return std::tuple(number_of(a.inner, 3), a.inner, a.outer) <
               std::tuple(number_of(b.inner, 3), b.inner, b.outer);
    });
    std::vector<bool> held = fixed;  // by what lies within it
    for (int round = 0; round < kMostLayers; ++round) {
        bool changed = false;
        for (const Shells& s : shells) {
            if (!held[s.inner] || fixed[s.outer]) continue;
            if (radius[s.outer] - radius[s.inner] >= s.want * (1 - 1e-6)) continue;
            radius[s.outer] = radius[s.inner] + s.want;
            held[s.outer] = moves[s.outer] = changed = true;
        }
        for (size_t k = shells.size(); k-- > 0;) {
            const Shells& s = shells[k];
            if (held[s.inner] || radius[s.outer] - radius[s.inner] >= s.want * (1 - 1e-6)) continue;
            radius[s.inner] = std::max(radius[s.outer] - s.want, 0.5 * radius[s.inner]);
            moves[s.inner] = changed = true;
        }
        if (!changed) break;
    }
    for (uint32_t i = 0; i < count; ++i) {
        if (!moves[i]) continue;
        const uint32_t primitive = view.first_sphere + i;
        float* record = records.empty() ? view.spheres + kSphereFloats * i
                                        : &records[size_t{primitive} * kRecordFloats];
        record[6] = static_cast<float>(radius[i]);
        record[7] = static_cast<float>(radius[i] - static_cast<double>(record[6]));
        for (uint32_t k = 6; k < 8; ++k) column(primitive, k) = record[k];
        if (records.empty()) continue;
        float* box = &round_boxes[6 * (in.disks.count + i)];
        for (int k = 0; k < 3; ++k) {
            box[k] = static_cast<float>(places[i].low[k] - radius[i]);
            box[3 + k] = static_cast<float>(places[i].high[k] + radius[i]);
        }
    }
}

}  // namespace veriray
