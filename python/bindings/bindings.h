// What the bindings share. Compiled once: a module's back end is what it is linked with.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "api/testing.h"

namespace py = pybind11;
using namespace veriray;

void bind_renderer(py::module_& m);
void bind_testing(py::module_& m);

Sampler find_sampler(const std::string& name);
// The means without a copy, read-only; of a CPU's picture.
py::array picture_view(const std::shared_ptr<Picture>& picture);
// What DLPack asks of the means: kind and number of the device, and a capsule, by version 1.0 of
// the protocol or by that before.
py::tuple dlpack_device(const Picture& picture);
py::capsule dlpack(const std::shared_ptr<Picture>& picture, bool versioned);
// Nodes (n, 7 * width) and primitives by slot, both uint32.
py::tuple tree_arrays(const TreeWords& tree, uint32_t width);

template <class T>
using Array = py::array_t<T, py::array::c_style | py::array::forcecast>;

template <class T>
void need_shape(const Array<T>& a, const std::string& name, const std::vector<py::ssize_t>& shape) {
    bool ok = a.ndim() == static_cast<py::ssize_t>(shape.size());
    py::ssize_t axis = 0;
    std::string want;
    for (const py::ssize_t n : shape) {
        if (ok && n >= 0 && a.shape(axis) != n) ok = false;
        want += (axis ? ", " : "") + (n < 0 ? std::string("n") : std::to_string(n));
        ++axis;
    }
    if (!ok) throw py::value_error(name + " must have the shape (" + want + ")");
}

template <class T>
py::array_t<T> to_array(const std::vector<T>& v, std::vector<py::ssize_t> shape) {
    py::array_t<T> out(shape);
    std::copy(v.begin(), v.end(), out.mutable_data());
    return out;
}

template <class T>
std::vector<T> to_vector(const Array<T>& a) {
    return {a.data(), a.data() + a.size()};
}
