// What the bindings share. Compiled once: a module's back end is what it is linked with.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <typeinfo>

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

// While it lives, the thread runs without the interpreter's lock. If the interpreter ends
// meanwhile, a thread other than the main one waits here for the end of the process: the
// interpreter would unwind its stack, and end the process by an abort at the first destructor that
// does not allow it.
class Unlocked {
   public:
    Unlocked() : state_(PyEval_SaveThread()) {}
    Unlocked(const Unlocked&) = delete;
    Unlocked& operator=(const Unlocked&) = delete;
    ~Unlocked() noexcept(false) {
        while (ending() && gettid() != getpid()) pause();
        PyEval_RestoreThread(state_);
    }

   private:
    static bool ending() {
#if PY_VERSION_HEX >= 0x030d0000
        return Py_IsFinalizing();
#else
        return _Py_IsFinalizing();
#endif
    }
    PyThreadState* state_;
};

template <class T>
using Array = py::array_t<T, py::array::c_style | py::array::forcecast>;

// Arrays whose numbers are all alike, by their size, type and number.
using Alike = std::map<std::string, py::object>;

// The array itself, or of a long one whose numbers share their memory (strides of 0) a copy, which
// takes no memory until it is written if the number is 0; equal ones are one.
template <class T>
Array<T> dense(const py::object& given, Alike& alike) {
    if (!py::isinstance<py::array_t<T>>(given)) return given.cast<Array<T>>();
    const auto a = py::reinterpret_borrow<py::array_t<T>>(given);
    bool same = a.ndim() > 0 && a.size() >= 1 << 12;
    for (py::ssize_t k = 0; k < a.ndim(); ++k) same = same && a.strides(k) == 0;
    if (!same) return given.cast<Array<T>>();
    const T value = *a.data();
    std::string key(reinterpret_cast<const char*>(&value), sizeof value);
    key += typeid(T).name();
    for (py::ssize_t k = 0; k < a.ndim(); ++k) key += " " + std::to_string(a.shape(k));
    py::object& made = alike[key];
    if (!made) {
        const size_t n = static_cast<size_t>(a.size());
        T* const memory = static_cast<T*>(std::calloc(n, sizeof(T)));
        if (!memory) throw std::bad_alloc();
        const py::capsule owner(memory, [](void* p) { std::free(p); });
        if (value != T{}) std::fill_n(memory, n, value);
        made = Array<T>(std::vector<py::ssize_t>(a.shape(), a.shape() + a.ndim()), memory, owner);
    }
    return py::reinterpret_borrow<Array<T>>(made);
}

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

// Without a copy.
template <class T>
py::array_t<T> moved_array(std::vector<T>&& v, std::vector<py::ssize_t> shape) {
    auto* const kept = new std::vector<T>(std::move(v));
    const py::capsule owner(kept, [](void* p) { delete static_cast<std::vector<T>*>(p); });
    return py::array_t<T>(std::move(shape), kept->data(), owner);
}
