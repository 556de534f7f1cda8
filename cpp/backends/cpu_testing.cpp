// Hooks of the test suite, on the CPU.
#include <atomic>

#include "backends/hooks.h"
#include "backends/leaks.h"
#include "backends/testing.h"
#include "scene/thread_pool.h"
#include "scene/tree_layout.h"

namespace veriray {

TreeWords host_ploc(const Scene& scene, uint32_t width, uint32_t threads) {
    if (width == kCpuWidth)
        return tree_words(
            build_ploc<kCpuWidth>(scene.host().tree_input(), kSimdWalk<kCpuLeaf>, threads, {}));
    return host_ploc(scene.host(), kSimdWalk<kCpuLeaf>, width, threads);
}

std::pair<size_t, size_t> function_shape(const std::string& name) {
    const FunctionInfo& f = kFunctions[find_function(name)];
    return {f.inputs, f.outputs};
}

// Every row goes through the vector lanes, and those of the first kAll rows and one of each later
// group, in turn, through the scalar ones, which must agree.
std::vector<float> eval_function(const std::string& name, const std::vector<float>& x) {
    const uint32_t which = find_function(name);
    const auto [inputs, outputs] = function_shape(name);
    const size_t n = x.size() / inputs;
    constexpr size_t kAll = 16 * Simd::kWidth;
    std::vector<float> y(n * outputs);
    for (size_t i = 0; i < n; i += Simd::kWidth) {
        const size_t live = std::min<size_t>(Simd::kWidth, n - i);
        Simd::F in[kMaxColumns], out[kMaxColumns];
        float column[Simd::kWidth], row[kMaxColumns];
        for (size_t c = 0; c < inputs; ++c) {
            for (size_t k = 0; k < Simd::kWidth; ++k)
                column[k] = x[(i + std::min(k, live - 1)) * inputs + c];
            in[c] = load(column, Simd::F());
        }
        evaluate<Simd>(which, in, out);
        for (size_t c = 0; c < outputs; ++c) {
            store(column, out[c]);
            for (size_t k = 0; k < live; ++k) y[(i + k) * outputs + c] = column[k];
        }
        if (Simd::kWidth == 1) continue;  // the same code
        const size_t turn = i / Simd::kWidth % live;
        for (size_t k = i < kAll ? 0 : turn; k < (i < kAll ? live : turn + 1); ++k) {
            evaluate<Scalar>(which, &x[(i + k) * inputs], row);
            if (std::memcmp(row, &y[(i + k) * outputs], outputs * sizeof(float)))
                throw std::logic_error(name + ": scalar and vector lanes differ");
        }
    }
    return y;
}

std::vector<uint32_t> random_words(uint64_t seed, Sampler sampler,
                                   const std::vector<uint32_t>& pixel,
                                   const std::vector<uint64_t>& sample,
                                   const std::vector<uint32_t>& block) {
    std::vector<uint32_t> out;
    for (size_t i = 0; i < pixel.size(); ++i) {
        const RandomKey key = random_key(seed, static_cast<uint32_t>(sample[i] >> 32), sampler);
        const Block<uint32_t> r =
            random_block(key, pixel[i], static_cast<uint32_t>(sample[i]), block[i]);
        out.insert(out.end(), {r.x, r.y, r.z, r.w});
    }
    return out;
}

namespace {
constexpr uint32_t kHookThreads = 8;
}  // namespace

FaultLog add_values(Film& film, const std::string& plane, float scale,
                    const std::vector<uint32_t>& pixel, const std::vector<float>& x) {
    FaultLog faults{};
    const AddValues add_row{checked_plane(film, plane, scale, pixel, x), &faults, pixel.data(),
                            x.data()};
    parallel(kHookThreads, pixel.size(), {}, [&](uint32_t, uint64_t i) { add_row(i); });
    return faults;
}

void add_integers(Film& film, const std::string& plane, const std::vector<uint32_t>& pixel,
                  const std::vector<uint64_t>& x) {
    const AddIntegers add_row{checked_plane(film, plane, 0, pixel, x), pixel.data(), x.data()};
    parallel(kHookThreads, pixel.size(), {}, [&](uint32_t, uint64_t i) { add_row(i); });
}

std::pair<std::vector<float>, uint32_t> light_tree(const Scene& scene) {
    const Table<float>& branches = scene.host().light_tree;
    return {{branches.begin(), branches.end()}, scene.host().view.lights.tree.root};
}

// Through the vector and the scalar lanes, which must agree.
LightAnswer choose_lights(const Scene& scene, const double* points, const double* normals,
                          LightQuery query) {
    const HostScene& host = scene.host();
    query = light_query(host, points, normals, std::move(query));
    const size_t n = query.row.size();
    LightAnswer a{std::vector<uint32_t>(n), std::vector<float>(n), std::vector<float>(n)};
    for (size_t i = 0; i < n; i += Simd::kWidth) {
        const uint32_t live = static_cast<uint32_t>(std::min<size_t>(Simd::kWidth, n - i));
        float numbers[8][Simd::kWidth] = {};
        uint32_t words[4][Simd::kWidth] = {};
        for (uint32_t k = 0; k < live; ++k) {
            for (int c = 0; c < 6; ++c) numbers[c][k] = query.places[6 * (i + k) + c];
            words[0][k] = query.sides[i + k], words[1][k] = query.u24[i + k];
            words[2][k] = query.row[i + k];
        }
        Simd::F place[6], chance, of_row;
        Simd::U word[4];
        for (int c = 0; c < 6; ++c) place[c] = load(numbers[c], Simd::F());
        for (int c = 0; c < 3; ++c) word[c] = load(words[c], Simd::U());
        answer_light<Simd>(host.view.lights, place, word[0], word[1], word[2], word[3], chance,
                           of_row, first_lanes(live, Simd::M()));
        store(words[3], word[3]), store(numbers[6], chance), store(numbers[7], of_row);
        for (uint32_t k = 0; k < live; ++k) {
            answer_light<Scalar>(host.view.lights, &query.places[6 * (i + k)], query.sides[i + k],
                                 query.u24[i + k], query.row[i + k], a.chosen[i + k],
                                 a.chance[i + k], a.of_row[i + k], true);
            if (a.chosen[i + k] != words[3][k] || a.chance[i + k] != numbers[6][k] ||
                a.of_row[i + k] != numbers[7][k])
                throw std::logic_error("choose_lights: scalar and vector lanes differ");
        }
    }
    return a;
}

// The closest hits; rays in turn, by code for all shapes, one after another, by code for those of
// the tree, side by side and alone must meet the same, and shadow rays a hit where there is one.
static Hit<Simd> closest_either_way(SceneView view, const Ray<Simd>& ray, Simd::M lanes) {
    using Reader = SurfaceReader<Simd, kAllFeatures>;
    const auto nothing = nothing_met<Simd>();
    Hit<Simd> hit[2];
    for (const uint32_t large : {0u, 1u}) {
        view.bvh.large = large;
        view.bvh.round |= large;
        hit[large] = Reader::closest(view, ray, nothing, Simd::F(kInfinity), lanes);
        if (!(view.features & kBvh)) return hit[0];
        const auto blocked = occluded_in_bvh<Simd, Reader::kTreeKinds>(
            view.bvh, ray, Simd::F(kInfinity), lanes, Simd::U(~0u));
        const auto met = lanes & (hit[large].t < Simd::F(kInfinity));
        if (any((blocked & !met) | (met & !blocked)))
            throw std::logic_error("intersect: closest and any hit differ");
    }
    for (uint32_t k = 0; k < Simd::kWidth; ++k) {
        const auto lane = lanes & mask_of(1u << k, lanes);
        const Hit<Simd> alone = Reader::closest(view, ray, nothing, Simd::F(kInfinity), lane);
        for (const auto& h : hit)
            if (any(lane & !((h.t == alone.t) & (h.primitive == alone.primitive))))
                throw std::logic_error("intersect: rays together and alone differ");
    }
    return hit[0];
}

void intersect(const Scene& scene, const double* origins, const double* directions, size_t n,
               float* t, int32_t* triangle) {
    const HostScene& host = scene.host();
    for (size_t i = 0; i < n; i += Simd::kWidth) {
        float rays[6][Simd::kWidth] = {}, distance[Simd::kWidth];
        uint32_t primitive[Simd::kWidth];
        const uint32_t live = static_cast<uint32_t>(std::min<size_t>(Simd::kWidth, n - i));
        for (uint32_t k = 0; k < live; ++k) {
            float ray[6];
            normalise_ray(host, origins + 3 * (i + k), directions + 3 * (i + k), ray);
            for (int c = 0; c < 6; ++c) rays[c][k] = ray[c];
        }
        const auto column = [&](int c) { return load(rays[c], Simd::F()); };
        const Ray<Simd> ray{{column(0), column(1), column(2)}, {column(3), column(4), column(5)}};
        const auto lanes = first_lanes(live, Simd::M());
        const Hit<Simd> hit = closest_either_way(host.view, ray, lanes);
        const auto all = first_lanes(Simd::kWidth, Simd::M());
        compress_store(distance, hit.t, all);
        compress_store(primitive, hit.primitive, all);
        for (uint32_t k = 0; k < live; ++k) {
            const bool met = distance[k] < kInfinity;
            t[i + k] = met ? static_cast<float>(distance[k] * host.unit) : kInfinity;
            triangle[i + k] = met ? static_cast<int32_t>(host.input_index[primitive[k]]) : -1;
        }
    }
}

std::pair<uint64_t, uint64_t> count_leaks(const Scene& scene, const double* origins,
                                          size_t origin_count, uint64_t first, uint64_t n) {
    const HostScene& host = scene.host();
    const std::vector<float> corners = leak_corners(host);
    const std::vector<float> from = leak_origins(host, origins, origin_count);
    const LeakTargets targets{corners.data(), static_cast<uint32_t>(corners.size() / 9),
                              from.data(), static_cast<uint32_t>(origin_count)};
    std::atomic<uint64_t> missed[2] = {0, 0};
    constexpr uint64_t kPart = 1 << 16;
    parallel(std::max(1u, std::thread::hardware_concurrency()), (n + kPart - 1) / kPart, {},
             [&](uint32_t, uint64_t part) {
                 uint64_t counts[2] = {0, 0};
                 for (uint64_t i = part * kPart; i < std::min(n, (part + 1) * kPart); ++i) {
                     bool at_edge;
                     if (leaks(host.view, targets, first + i, at_edge)) ++counts[at_edge];
                 }
                 missed[0] += counts[0], missed[1] += counts[1];
             });
    return {missed[0], missed[1]};
}

}  // namespace veriray
