// Sheets that are made of two faces with the same corners, back to back, in scenes with a tree: the
// later one's plane is moved before its front, so that each side is seen from where it faces.
#include <algorithm>
#include <atomic>
#include <bit>
#include <mutex>
#include <vector>

#include "scene/edge_hash.h"
#include "scene/touching.h"

namespace veriray {
namespace {

// The largest number of faces with the same corners that one is compared with.
constexpr size_t kMostAlike = 32;

// Marks of hashes, 16 bits for each of n.
class Marks {
   public:
    explicit Marks(size_t n) : words_(std::bit_ceil(n / 4 + 1)) {}

    // Whether that of a hash was set before.
    bool set(uint64_t hash) {
        const uint64_t bit = uint64_t{1} << (hash & 63);
        return (word(hash).fetch_or(bit, std::memory_order_relaxed) & bit) != 0;
    }
    bool holds(uint64_t hash) {
        return (word(hash).load(std::memory_order_relaxed) >> (hash & 63) & 1) != 0;
    }

   private:
    std::atomic<uint64_t>& word(uint64_t hash) { return words_[hash >> 6 & (words_.size() - 1)]; }
    std::vector<std::atomic<uint64_t>> words_;
};

}  // namespace

void HostScene::part_twins(const SceneInput& in) {
    const size_t count = view.first_sphere - in.disks.count;
    const auto& faces = std::as_const(sources);
    bool any = in.emissions.count > 0;
    for (uint32_t m = 0; m < in.material_kind.count; ++m)
        any |= !clear_material(in, m) && !in.sees_both_sides(m);
    if (!any) return;
    const auto corner = [&](size_t i, uint32_t k) {
        return row3(in.vertices, in.triangles.data[3 * faces[i].row + k]);
    };
    const auto hash = [&](size_t i) {
        return mixed(hashed(corner(i, 0)) + hashed(corner(i, 1)) + hashed(corner(i, 2)));
    };
    Marks once(count), twice(count);
    in_chunks(kAllThreads, count, [&](size_t first, size_t last) {
        for (size_t i = first; i < last; ++i)
            if (const uint64_t h = hash(i); once.set(h)) twice.set(h);
    });
    std::vector<std::pair<uint64_t, uint32_t>> alike;
    std::mutex mutex;
    in_chunks(kAllThreads, count, [&](size_t first, size_t last) {
        std::vector<std::pair<uint64_t, uint32_t>> here;
        for (size_t i = first; i < last; ++i)
            if (const uint64_t h = hash(i); twice.holds(h))
                here.emplace_back(h, static_cast<uint32_t>(i));
        const std::lock_guard lock(mutex);
        alike.insert(alike.end(), here.begin(), here.end());
    });
    std::sort(alike.begin(), alike.end());
    const auto normal = [&](uint32_t i) {
        const auto n = [&](uint32_t k) { return double{column(i, kPrimN + k)}; };
        return Double3{n(0), n(1), n(2)};
    };
    const auto twins = [&](uint32_t a, uint32_t b) {
        if (!sides_differ(in, faces[a], faces[b])) return false;
        for (uint32_t k = 0; k < 3; ++k) {
            const auto same = [&](uint32_t m) { return length(corner(a, k) - corner(b, m)) == 0; };
            if (!same(0) && !same(1) && !same(2)) return false;
        }
        return dot(normal(a), normal(b)) < 0;
    };
    for (size_t k = 1; k < alike.size(); ++k)
        for (size_t before = k;
             before > 0 && k - before < kMostAlike && alike[before - 1].first == alike[k].first;
             --before) {
            const uint32_t b = alike[k].second;
            if (!twins(alike[before - 1].second, b)) continue;
            // As faces in contact are parted that are seen from afar (touching.cpp), but not far
            // off a small one.
            const Box box = box_around(in, b);
            const double away = kParted * (terms(box, normal(b)) + 0.5),
                         most = length(box.high - box.low) * 0x1p-6;
            move_plane(b, std::min(away, most));
            slab_slack = std::max(slab_slack, kMovedSlack);
            break;
        }
}

}  // namespace veriray
