// The CUDA module.
#include "bindings.h"

PYBIND11_MODULE(_cuda, m) {
    using namespace py::literals;
    bind_renderer(m);
    bind_testing(m);
    m.def(
        "add_kernels",
        [](int device, uint64_t features, const py::bytes& code) {
            const std::string text = code;
            Unlocked unlocked;
            add_kernels(device, features, text);
        },
        "device"_a, "features"_a, "code"_a);
    m.def("device_tree",
          [](const Scene& scene) { return tree_arrays(device_tree(scene), kDeviceWidth); });
    m.def("intersect_width", [](const Scene& scene, uint32_t width, const Array<double>& origins,
                                const Array<double>& directions) {
        need_shape(origins, "origins", {-1, 3});
        need_shape(directions, "directions", {origins.shape(0), 3});
        const py::ssize_t n = origins.shape(0);
        py::array_t<float> t(n);
        py::array_t<int32_t> primitive(n);
        const double seconds =
            intersect_width(scene, width, origins.data(), directions.data(), static_cast<size_t>(n),
                            t.mutable_data(), primitive.mutable_data());
        return py::make_tuple(t, primitive, seconds);
    });
}
