// What the hooks of the test suite do alike on both back ends.
#pragma once

#include <cstring>

#include "api/testing.h"
#include "backends/film_memory.h"
#include "backends/instances.h"
#include "integrators/called.h"

namespace veriray {

template <uint32_t N>
TreeWords tree_words(const WideTree<N>& tree) {
    TreeWords out{std::vector<uint32_t>(tree.nodes.size() * 7 * N), tree.order};
    for (size_t i = 0; i < tree.nodes.size(); ++i)
        std::memcpy(&out.nodes[i * 7 * N], &tree.nodes[i], 7 * N * sizeof(uint32_t));
    return out;
}

// Calls fn.template operator()<width>().
template <class Fn>
auto with_width(uint32_t width, Fn fn) {
    if (width == 2) return fn.template operator()<2>();
    if (width == 4) return fn.template operator()<4>();
    if (width == 8) return fn.template operator()<8>();
    throw std::invalid_argument("width = " + std::to_string(width) + "; allowed: 2, 4, 8");
}

inline TreeWords host_ploc(const HostScene& host, const WalkCost& walk, uint32_t width,
                           uint32_t threads) {
    return with_width(width, [&]<uint32_t N>() {
        return tree_words(build_ploc<N>(host.tree_input(), walk, threads, {}));
    });
}

// World rays to normalised ones.
inline void normalise_ray(const HostScene& scene, const double* o, const double* d, float out[6]) {
    const Double3 origin = (Double3{o[0], o[1], o[2]} - scene.centre) * (1.0 / scene.unit);
    const Double3 unit = normalised({d[0], d[1], d[2]});
    for (int k = 0; k < 3; ++k) {
        out[k] = static_cast<float>(origin[k]);
        out[3 + k] = static_cast<float>(unit[k]);
    }
}

// The query with its places.
inline LightQuery light_query(const HostScene& scene, const double* points, const double* normals,
                              LightQuery query) {
    const uint32_t count = scene.view.lights.count;
    if (count < 2) throw std::invalid_argument("a choice needs more than one light");
    for (const uint32_t row : query.row)
        if (row >= count)
            throw std::invalid_argument("the scene has no light " + std::to_string(row));
    query.places.resize(6 * query.row.size());
    for (size_t i = 0; i < query.row.size(); ++i)
        normalise_ray(scene, points + 3 * i, normals + 3 * i, &query.places[6 * i]);
    return query;
}

// One of them; the numbers of a deep tree follow from u24.
template <class L>
VR_HD void answer_light(const LightView& lights, const typename L::F place[6], typename L::U sides,
                        typename L::U u24, typename L::U row, typename L::U& chosen,
                        typename L::F& chance, typename L::F& of_row, typename L::M lanes) {
    using U = typename L::U;
    const Vec3<typename L::F> p{place[0], place[1], place[2]}, n{place[3], place[4], place[5]};
    const LightReceiver<L> at{p, facing(n, sides)};
    const auto choice = LightTree<L>::choose(lights.tree, at, u24, {u24, sides, U(0u)}, lanes);
    chosen = choice.row, chance = choice.chance;
    const U leaf = as_uint(gather(lights.table + kLightLeaf * lights.stride, row));
    of_row = LightTree<L>::chance(lights.tree, at, leaf, lanes);
}

// The plane to which rows of x are added.
template <class T>
PlaneView checked_plane(Film& film, const std::string& name, float scale,
                        const std::vector<uint32_t>& pixel, const std::vector<T>& x) {
    const PlaneView plane = film.impl->plane(name, scale);
    if (x.size() != pixel.size() * plane.channels)
        throw std::invalid_argument(std::to_string(x.size()) + " numbers for " +
                                    std::to_string(pixel.size()) + " samples of " +
                                    std::to_string(plane.channels) + " channels");
    for (const uint32_t k : pixel)
        if (k >= static_cast<uint64_t>(film.width()) * film.height())
            throw std::invalid_argument("the film has no pixel " + std::to_string(k));
    return plane;
}

// Adds row i.
struct AddValues {
    PlaneView plane;
    FaultLog* faults;
    const uint32_t* pixel;
    const float* x;
    VR_HD void operator()(uint64_t i) const {
        add_values(plane, faults, pixel[i], static_cast<uint32_t>(i), x + i * plane.channels);
    }
};
struct AddIntegers {
    PlaneView plane;
    const uint32_t* pixel;
    const uint64_t* x;
    VR_HD void operator()(uint64_t i) const {
        add_integers(plane, pixel[i], x + i * plane.channels);
    }
};

}  // namespace veriray
