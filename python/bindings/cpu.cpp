// The CPU modules: one for each instruction set.
#include "bindings.h"

namespace {

py::list trace_list(const Scene& scene, uint64_t seed, uint32_t x, uint32_t y, uint64_t sample,
                    int64_t max_depth, uint32_t rr_depth, const std::string& sampler) {
    RenderSettings s;
    s.seed = seed;
    s.sampler = find_sampler(sampler);
    s.max_depth = max_depth;
    s.rr_depth = rr_depth;
    py::list out;
    using namespace py::literals;
    const auto triple = [](const auto* v) { return py::make_tuple(v[0], v[1], v[2]); };
    for (const PathVertex& v : trace_path(scene, s, x, y, sample))
        out.append(py::dict("depth"_a = v.depth, "event"_a = v.event,
                            "position"_a = triple(v.position), "direction"_a = triple(v.direction),
                            "normal"_a = triple(v.normal), "t"_a = v.t,
                            "throughput"_a = triple(v.throughput),
                            "radiance"_a = triple(v.radiance), "primitive"_a = v.primitive,
                            "shadow"_a = v.shadow < 0    ? py::object(py::none())
                                         : v.shadow == 1 ? py::object(py::str("visible"))
                                                         : py::object(py::str("occluded"))));
    return out;
}

void bind_cpu(py::module_& m) {
    using namespace py::literals;
    bind_renderer(m);
    bind_testing(m);
    m.def("trace_path", &trace_list, "scene"_a, py::kw_only(), "seed"_a = 0, "x"_a = 0, "y"_a = 0,
          "sample"_a = 0, "max_depth"_a = -1, "rr_depth"_a = 5, "sampler"_a = "sobol");
}

}  // namespace

PYBIND11_MODULE(_cpu, m) { bind_cpu(m); }
PYBIND11_MODULE(_cpu_v3, m) { bind_cpu(m); }
PYBIND11_MODULE(_cpu_v4, m) { bind_cpu(m); }
