// Hooks of the test suite.
#include "bindings.h"

py::tuple tree_arrays(const TreeWords& tree, uint32_t width) {
    const py::ssize_t row = 7 * static_cast<py::ssize_t>(width);
    return py::make_tuple(
        to_array(tree.nodes, {static_cast<py::ssize_t>(tree.nodes.size()) / row, row}),
        to_array(tree.order, {static_cast<py::ssize_t>(tree.order.size())}));
}

void bind_testing(py::module_& m) {
    using namespace py::literals;
    m.def("eval_function", [](const std::string& name, const Array<float>& x) {
        const auto [inputs, outputs] = function_shape(name);
        const auto columns = static_cast<py::ssize_t>(inputs);
        need_shape(x, "x", {-1, columns});
        return to_array(eval_function(name, to_vector(x)),
                        {x.shape(0), static_cast<py::ssize_t>(outputs)});
    });
    m.def(
        "random",
        [](uint64_t seed, const Array<uint32_t>& pixel, const Array<uint64_t>& sample,
           const Array<uint32_t>& block, const std::string& sampler) {
            if (pixel.size() != sample.size() || pixel.size() != block.size())
                throw py::value_error("pixel, sample and block must have the same length");
            return to_array(random_words(seed, find_sampler(sampler), to_vector(pixel),
                                         to_vector(sample), to_vector(block)),
                            {pixel.size(), 4});
        },
        "seed"_a, "pixel"_a, "sample"_a, "block"_a, "sampler"_a = "independent");
    m.def(
        "add_values",
        [](Film& film, const std::string& plane, float scale, const Array<uint32_t>& pixel,
           const Array<float>& x) {
            const FaultLog log = add_values(film, plane, scale, to_vector(pixel), to_vector(x));
            py::list first;
            for (uint64_t i = 0; i < std::min<uint64_t>(log.count, kMaxFaults); ++i)
                first.append(py::make_tuple(log.first[i].pixel, log.first[i].sample,
                                            log.first[i].radiance[0], log.first[i].radiance[1],
                                            log.first[i].radiance[2]));
            return py::make_tuple(log.count, first);
        },
        "film"_a, "plane"_a, "scale"_a, "pixel"_a, "x"_a);
    m.def(
        "add_integers",
        [](Film& film, const std::string& plane, const Array<uint32_t>& pixel,
           const Array<uint64_t>& x) { add_integers(film, plane, to_vector(pixel), to_vector(x)); },
        "film"_a, "plane"_a, "pixel"_a, "x"_a);
    m.def("intersect",
          [](const Scene& scene, const Array<double>& origins, const Array<double>& directions) {
              need_shape(origins, "origins", {-1, 3});
              need_shape(directions, "directions", {origins.shape(0), 3});
              const py::ssize_t n = origins.shape(0);
              py::array_t<float> t(n);
              py::array_t<int32_t> primitive(n);
              intersect(scene, origins.data(), directions.data(), static_cast<size_t>(n),
                        t.mutable_data(), primitive.mutable_data());
              return py::make_tuple(t, primitive);
          });
    m.def(
        "choose_lights",
        [](const Scene& scene, const Array<double>& points, const Array<double>& normals,
           const Array<uint32_t>& sides, const Array<uint32_t>& u24, const Array<uint32_t>& row) {
            need_shape(points, "points", {-1, 3});
            const py::ssize_t n = points.shape(0);
            need_shape(normals, "normals", {n, 3});
            if (sides.size() != n || u24.size() != n || row.size() != n)
                throw py::value_error("sides, u24 and row must have a number for each point");
            const LightAnswer a =
                choose_lights(scene, points.data(), normals.data(),
                              {{}, to_vector(sides), to_vector(u24), to_vector(row)});
            return py::make_tuple(to_array(a.chosen, {n}), to_array(a.chance, {n}),
                                  to_array(a.of_row, {n}));
        },
        "scene"_a, "points"_a, "normals"_a, "sides"_a, "u24"_a, "row"_a);
    m.def(
        "light_tree",
        [](const Scene& scene) {
            const auto [branches, root] = light_tree(scene);
            const py::ssize_t row = kBranchFloats;
            return py::make_tuple(
                to_array(branches, {static_cast<py::ssize_t>(branches.size()) / row, row}), root);
        },
        "scene"_a);
    m.def("count_leaks", [](const Scene& scene, const Array<double>& origins, uint64_t first,
                            uint64_t n) {
        need_shape(origins, "origins", {-1, 3});
        Unlocked unlocked;
        return count_leaks(scene, origins.data(), static_cast<size_t>(origins.shape(0)), first, n);
    });
    m.def(
        "host_ploc",
        [](const Scene& scene, uint32_t width, uint32_t threads) {
            return tree_arrays(host_ploc(scene, width, threads), width);
        },
        "scene"_a, "width"_a, "threads"_a = 0);
}
