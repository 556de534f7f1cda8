// What every module binds: checks and converts arrays, releases the GIL, renders nothing itself.
#include <pybind11/functional.h>

#include <algorithm>
#include <map>
#include <system_error>

#include "bindings.h"

namespace {

// The arrays that a scene's input points to, by name; those of its camera change with that.
using Arrays = std::map<std::string, py::object>;
struct Kept {
    std::shared_ptr<const Arrays> arrays;
    py::object patches;
};

// Rows of given[name], which are kept alive, or else those that the input has.
struct Reader {
    const py::dict& given;
    Arrays& kept;
    Alike alike;

    // shape: of a row; table: `scene` has one row, which the array is.
    template <class T>
    void operator()(const std::string& table, const char* name, Rows<T>& rows,
                    std::vector<py::ssize_t> shape) {
        if (!given.contains(name)) {
            if (kept.count(name)) return;
            throw py::value_error(std::string("no array ") + name);
        }
        const Array<T> a = dense<T>(given[name], alike);
        const bool one = table == "scene";
        if (!one) shape.insert(shape.begin(), -1);
        need_shape(a, name, shape);
        kept[name] = a;
        rows = {a.data(), one ? 1 : static_cast<size_t>(a.shape(0))};
    }
};

void read_arrays(const py::dict& arrays, SceneInput& in, Arrays& kept) {
    Reader read{arrays, kept, {}};
#define VR_COLUMN(table, name, type, low, high, open, ...) \
    read(#table, #name, in.name, {__VA_ARGS__});
#define VR_INDEX(table, name, type, least, of, ...) read(#table, #name, in.name, {__VA_ARGS__});
#define VR_KIND(table, name, type, kinds, ...) read(#table, #name, in.name, {__VA_ARGS__});
#include "schema/columns.def"
}

void read_camera(const py::dict& camera, const py::dict& film, SceneInput& in, Kept& kept) {
    const auto numbers = [&]<class T>(const py::dict& from, const char* name, T* out,
                                      const std::vector<py::ssize_t>& shape) {
        const auto a = from[name].cast<Array<T>>();
        need_shape(a, name, shape);
        std::copy_n(a.data(), a.size(), out);
    };
    numbers(camera, "to_world", in.to_world, {4, 4});
    in.parallel = camera["parallel"].cast<bool>();
    in.tan_half_x = camera["tan_half_x"].cast<double>();
    in.tan_half_y = camera["tan_half_y"].cast<double>();
    in.near_clip = camera["near_clip"].cast<double>();
    in.far_clip = camera["far_clip"].cast<double>();
    in.principal_x = camera["principal_x"].cast<double>();
    in.principal_y = camera["principal_y"].cast<double>();
    in.aperture_radius = camera["aperture_radius"].cast<double>();
    in.focus_distance = camera["focus_distance"].cast<double>();
    in.hides_light = camera["hides_light"].cast<bool>();
    in.camera_medium = camera["medium"].cast<int32_t>();
    const auto patches = camera["patches"].cast<Array<double>>();
    need_shape(patches, "patches", {-1, kPatchColumns});
    kept.patches = patches;
    in.meter_patches = {patches.data(), static_cast<size_t>(patches.shape(0))};
    in.meter_distant = camera["distant"].cast<bool>();
    in.width = film["width"].cast<uint32_t>();
    in.height = film["height"].cast<uint32_t>();
    in.filter = film["filter"].cast<std::string>();
    numbers(film, "filter_parameters", in.filter_parameters, {2});
}

// OutOfMemoryError for a lack of the host's memory.
template <class Make>
auto with_memory(const SceneInput& in, Make make) {
    try {
        return make();
    } catch (const std::bad_alloc& error) {
        const std::string why = error.what();  // of threads that cannot be had, in words
        throw OutOfMemoryError("scene: " +
                               (why != std::bad_alloc().what()
                                    ? why
                                    : "the host has too little memory for " +
                                          std::to_string(in.triangles.count) + " triangles"));
    }
}

// Ctrl-C and the callback are looked at on the calling thread; what they raise stops
// the render, or the build of a tree.
Poll poll_of(const py::object& poll) {
    return [&poll](double share) {
        py::gil_scoped_acquire acquire;
        if (PyErr_CheckSignals() != 0) throw py::error_already_set();
        if (!poll.is_none()) poll(share);
        return true;
    };
}

std::unique_ptr<Scene> make_scene(const py::dict& arrays, const py::dict& camera,
                                  const py::dict& film, int device, const py::object& progress,
                                  const std::string& builder) {
    SceneInput in{};
    const auto columns = std::make_shared<Arrays>();
    read_arrays(arrays, in, *columns);
    const std::shared_ptr<Kept> kept(new Kept{columns, {}});
    read_camera(camera, film, in, *kept);
    const BuildPoll poll = poll_of(progress);
    Unlocked unlocked;
    return with_memory(in,
                       [&] { return std::make_unique<Scene>(in, kept, device, builder, poll); });
}

std::unique_ptr<Scene> rebuilt_scene(const Scene& base, const std::string& builder,
                                     const py::object& progress) {
    const BuildPoll poll = poll_of(progress);
    Unlocked unlocked;
    return with_memory(base.input, [&] { return base.rebuilt(builder, poll); });
}

// arrays: those that differ. Where primitives differ, small scenes are made anew by the builder;
// None if that is empty or the scene is large, as its arrays' memory may be wanted first. rough:
// see HostScene::change.
std::unique_ptr<Scene> changed_scene(const Scene& base, const py::dict& arrays,
                                     const py::dict& camera, const py::dict& film, bool rough,
                                     int device, const std::string& builder) {
    SceneInput in = base.input;
    const auto kept = std::make_shared<Kept>(*static_cast<const Kept*>(base.owner.get()));
    if (!arrays.empty()) {
        const auto columns = std::make_shared<Arrays>(*kept->arrays);
        read_arrays(arrays, in, *columns);
        kept->arrays = columns;
    }
    read_camera(camera, film, in, *kept);
    const std::shared_ptr<const void> owner = kept;
    Unlocked unlocked;
    return with_memory(in, [&] {
        auto made = base.changed(in, owner, rough);
        if (!made && !builder.empty() && in.primitives() <= kMostSmall)
            made = std::make_unique<Scene>(in, owner, device, builder, [](double) { return true; });
        return made;
    });
}

std::vector<std::string> feature_names(FeatureMask mask) {
    std::vector<std::string> names;
    for (uint32_t k = 0; k < kFeatureCount; ++k)
        if (mask >> k & 1u) names.push_back(feature_name(k));
    return names;
}

FeatureMask to_mask(const std::vector<std::string>& names) {
    FeatureMask mask = 0;
    for (const std::string& name : names) {
        uint32_t k = 0;
        while (k < kFeatureCount && name != feature_name(k)) ++k;
        if (k == kFeatureCount) throw py::value_error("feature '" + name + "' is unknown");
        mask |= FeatureMask{1} << k;
    }
    return mask;
}

py::dict kernel_dict(const KernelUse& use) {
    if (use.registers == 0) return {};
    using namespace py::literals;
    return py::dict("registers"_a = use.registers, "local_bytes"_a = use.local_bytes,
                    "resident_threads"_a = use.resident_threads);
}

py::list faults_of(const RenderStats& stats) {
    py::list faults;
    for (const Fault& f : stats.faults)
        faults.append(
            py::make_tuple(f.x, f.y, f.sample, f.radiance[0], f.radiance[1], f.radiance[2]));
    return faults;
}

py::dict features_dict(const Scene& scene, Film& film, const FeatureSettings& s,
                       const py::object& poll) {
    RenderStats stats;
    {
        Unlocked unlocked;
        stats = render_features(scene, film, s, poll_of(poll));
    }
    using namespace py::literals;
    return py::dict("seconds"_a = stats.seconds, "nonfinite_samples"_a = stats.fault_count,
                    "nonfinite"_a = faults_of(stats), "device"_a = stats.device);
}

py::dict render_dict(const Scene& scene, Film& film, const RenderSettings& s,
                     const py::object& poll) {
    RenderStats stats;
    {
        Unlocked unlocked;
        stats = render(scene, film, s, poll_of(poll));
    }
    const py::ssize_t depths = static_cast<py::ssize_t>(stats.ledger.size() / kLedgerColumns);
    const py::list faults = faults_of(stats);
    using namespace py::literals;
    return py::dict(
        "ledger"_a = to_array(stats.ledger, {depths, kLedgerColumns}),
        "blocks"_a = to_array(stats.blocks, {static_cast<py::ssize_t>(stats.blocks.size())}),
        "depth_seconds"_a =
            to_array(stats.depth_seconds, {static_cast<py::ssize_t>(stats.depth_seconds.size())}),
        "compaction_seconds"_a = to_array(
            stats.compaction_seconds, {static_cast<py::ssize_t>(stats.compaction_seconds.size())}),
        "seconds"_a = stats.seconds, "nonfinite_samples"_a = stats.fault_count,
        "nonfinite"_a = faults, "launches"_a = stats.launches, "device"_a = stats.device,
        "scheduler"_a = s.scheduler, "features"_a = feature_names(stats.features),
        "threads"_a = stats.threads, "path_bytes"_a = path_bytes(stats.features),
        "kernel"_a = kernel_dict(stats.kernel));
}

// A value of a state's dictionary; where: what the dictionary is.
template <class T>
T value_of(const py::dict& from, const std::string& where, const char* name) {
    if (!from.contains(name)) throw py::value_error(where + " has no '" + name + "'");
    try {
        return from[name].cast<T>();
    } catch (const std::exception&) {  // of pybind11 or of the object's own conversion
        throw py::value_error(where + ": '" + name + "' has no valid value");
    }
}

PlaneInfo plane_info(const py::dict& from, const std::string& where) {
    PlaneInfo p{value_of<std::string>(from, where, "name"), PlaneKind::kSums,
                value_of<uint32_t>(from, where, "channels"),
                value_of<bool>(from, where, "negative")};
    const auto kind = value_of<std::string>(from, where, "kind");
    const auto* found = std::find(std::begin(kPlaneKinds), std::end(kPlaneKinds), kind);
    if (found == std::end(kPlaneKinds))
        throw py::value_error(where + ": kind = '" + kind +
                              "'; allowed: sums and squares, sums, integers");
    p.kind = static_cast<PlaneKind>(found - kPlaneKinds);
    return p;
}

// Calls fn(plane, "plane i") for a list of dictionaries.
template <class Fn>
void each_plane(const py::list& planes, Fn fn) {
    size_t i = 0;
    for (const py::handle item : planes) {
        const std::string where = "plane " + std::to_string(i++);
        if (!py::isinstance<py::dict>(item)) throw py::value_error(where + " is no dictionary");
        fn(py::reinterpret_borrow<py::dict>(item), where);
    }
}

std::unique_ptr<Film> make_film(uint32_t width, uint32_t height, int device,
                                const py::list& planes) {
    std::vector<PlaneInfo> more;
    each_plane(planes, [&](const py::dict& plane, const std::string& where) {
        more.push_back(plane_info(plane, where));
    });
    return std::make_unique<Film>(width, height, device, more);
}

std::vector<py::ssize_t> words_shape(const Film& film, const PlaneInfo& p) {
    return {film.height(), film.width(), p.channels, kPlaneWords[static_cast<uint32_t>(p.kind)]};
}

py::array_t<uint64_t> words_of(const Film& film, size_t plane) {
    py::array_t<uint64_t> out(words_shape(film, film.planes()[plane]));
    uint64_t* words = out.mutable_data();
    Unlocked unlocked;
    film.words(plane, words);
    return out;
}

py::dict state_of(const Film& film) {
    using namespace py::literals;
    py::list planes;
    for (size_t i = 0; i < film.planes().size(); ++i) {
        const PlaneInfo& p = film.planes()[i];
        planes.append(py::dict("name"_a = p.name,
                               "kind"_a = kPlaneKinds[static_cast<uint32_t>(p.kind)],
                               "channels"_a = p.channels, "negative"_a = p.negative,
                               "scale"_a = film.scale(i), "words"_a = words_of(film, i)));
    }
    return py::dict("samples"_a = film.samples(), "units"_a = film.units(), "planes"_a = planes);
}

void add_state(Film& film, const py::dict& state) {
    const auto samples = value_of<uint64_t>(state, "the state", "samples");
    const auto units = value_of<uint64_t>(state, "the state", "units");
    std::vector<PlaneState> planes;
    std::vector<py::object> keep;
    each_plane(value_of<py::list>(state, "the state", "planes"),
               [&](const py::dict& plane, const std::string& where) {
                   const PlaneInfo info = plane_info(plane, where);
                   const auto words = value_of<py::object>(plane, where, "words");
                   if (!py::isinstance<py::array_t<uint64_t>>(words))
                       throw py::value_error(where + ": words is no array of uint64");
                   const auto array = words.cast<Array<uint64_t>>();
                   need_shape(array, where + ": words", words_shape(film, info));
                   keep.push_back(array);
                   planes.push_back({info, value_of<float>(plane, where, "scale"), array.data()});
               });
    Unlocked unlocked;
    film.add(samples, units, planes);
}

std::shared_ptr<Picture> make_picture(const Film& film,
                                      const std::optional<Array<uint64_t>>& counts,
                                      uint32_t threads, size_t plane, bool units,
                                      const Film* tail) {
    if (counts) need_shape(*counts, "counts", {film.height(), film.width()});
    const uint64_t* n = counts ? counts->data() : nullptr;
    Unlocked unlocked;
    return std::make_shared<Picture>(film, n, threads, plane, units, tail);
}

std::vector<py::ssize_t> picture_shape(const Picture& p) {
    return {p.height(), p.width(), p.channels()};
}

// A new array with what `read` gives.
template <class T = float>
py::array_t<T> copied(const Picture& p, void (Picture::*read)(float*) const) {
    std::vector<py::ssize_t> shape = picture_shape(p);
    if (p.integers() && read == &Picture::read_error) shape[2] = 0;
    py::array_t<T> out(shape);
    auto* numbers = reinterpret_cast<float*>(out.mutable_data());
    Unlocked unlocked;
    (p.*read)(numbers);
    return out;
}

// An array of the picture's size in memory that `read` gives.
py::array_t<float> given(const Picture& p, Large<float> (Picture::*read)() const) {
    std::unique_ptr<Large<float>> all;
    {
        Unlocked unlocked;
        all = std::make_unique<Large<float>>((p.*read)());
    }
    float* const numbers = all->data();
    const py::capsule owner(all.get(), [](void* x) {
        const std::unique_ptr<Large<float>> held(static_cast<Large<float>*>(x));
        Picture::give_back(std::move(*held));
    });
    all.release();
    return py::array_t<float>(picture_shape(p), numbers, owner);
}

py::array image_of(const Picture& p) {
    if (p.integers()) return copied<uint32_t>(p, &Picture::read_mean);
    return given(p, &Picture::mean);
}

py::array error_of(const Picture& p) {
    if (p.integers()) return copied(p, &Picture::read_error);
    return given(p, &Picture::error);
}

// A table of the scene's form, without a copy.
py::array_t<uint32_t> table_view(const Table<uint32_t>& table) {
    using Rows = std::shared_ptr<const Large<uint32_t>>;
    auto keep = std::make_unique<Rows>(table.shared());
    const py::capsule owner(keep.get(), [](void* p) { delete static_cast<Rows*>(p); });
    keep.release();
    py::array_t<uint32_t> out(static_cast<py::ssize_t>(table.size()), table.data(), owner);
    out.attr("setflags")(false);
    return out;
}

}  // namespace

Sampler find_sampler(const std::string& name) {
    if (name == "independent") return Sampler::kIndependent;
    if (name == "sobol") return Sampler::kSobol;
    throw py::value_error("sampler = '" + name + "'; allowed: independent, sobol");
}

void bind_renderer(py::module_& m) {
    using namespace py::literals;
    m.doc() = "One backend of veriray; see veriray/_native.pyi.";
    try {  // takes memory once, without which the process would abort later
        throw 0;
    } catch (int) {
    }
    py::register_local_exception<DeviceError>(m, "DeviceError", PyExc_RuntimeError);
    py::register_local_exception<OutOfMemoryError>(m, "OutOfMemoryError", PyExc_MemoryError);
    py::register_local_exception_translator([](std::exception_ptr error) {
        try {
            std::rethrow_exception(error);
        } catch (const std::system_error& e) {  // of std::thread
            py::set_error(PyExc_MemoryError, (std::string("no thread: ") + e.what()).c_str());
        }
    });

    m.def("build_info", [] {
        const BuildInfo b = build_info();
        return py::dict("backend"_a = b.backend, "isa"_a = b.isa, "lanes"_a = b.lanes,
                        "compiler"_a = b.compiler, "thrust"_a = b.thrust,
                        "cuda_toolkit"_a = b.cuda_toolkit,
                        "cuda_architectures"_a = b.cuda_architectures);
    });
    m.def("status", [] {
        // Without the lock: a GPU's first answer takes a good part of a second.
        const std::string why = [] {
            Unlocked unlocked;
            return why_unusable();
        }();
        return py::make_tuple(why.empty(), why);
    });
    m.def("variants", [] {
        std::vector<std::vector<std::string>> out;
        for (const FeatureMask mask : variant_masks()) out.push_back(feature_names(mask));
        return out;
    });
    m.def("path_bytes", [](const std::vector<std::string>& f) { return path_bytes(to_mask(f)); });
    m.def("devices", [] {
        py::list out;
        for (const DeviceInfo& d : devices())
            out.append(py::dict("name"_a = d.name, "index"_a = d.index,
                                "compute_capability"_a = d.compute_capability,
                                "driver"_a = d.driver, "memory_total"_a = d.memory_total,
                                "memory_free"_a = d.memory_free,
                                "multiprocessors"_a = d.multiprocessors));
        return out;
    });

    py::class_<Scene>(m, "Scene", py::module_local())
        .def(py::init(&make_scene), "arrays"_a, "camera"_a, "film"_a, "device"_a = 0,
             "progress"_a = py::none(), "builder"_a = "sah")
        .def("changed", &changed_scene, "arrays"_a, "camera"_a, "film"_a, "rough"_a = false,
             "device"_a = 0, "builder"_a = "")
        .def("rebuilt", &rebuilt_scene, "builder"_a, "progress"_a = py::none())
        .def_property_readonly(
            "family", [](const Scene& s) { return reinterpret_cast<uintptr_t>(s.family()); })
        .def_property_readonly("features",
                               [](const Scene& s) { return feature_names(s.host().view.features); })
        .def_property_readonly("feature_mask",
                               [](const Scene& s) { return s.host().view.features; })
        .def_property_readonly("frame",
                               [](const Scene& s) {
                                   const auto& h = s.host();
                                   return py::make_tuple(
                                       py::make_tuple(h.centre.x, h.centre.y, h.centre.z), h.unit);
                               })
        .def_property_readonly(
            "variant", [](const Scene& s) { return feature_names(variant_mask(s.host().view)); })
        .def_property_readonly(
            "path_bytes", [](const Scene& s) { return path_bytes(variant_mask(s.host().view)); })
        .def_property_readonly("input_index",
                               [](const Scene& s) { return table_view(s.host().input_index); })
        .def_property_readonly(
            "primitives",
            [](const Scene& s) {
                const SceneView& v = s.host().view;
                const uint32_t others =
                    v.quad_count + v.polygon_count + v.disk_count + v.sphere_count;
                return py::dict("quads"_a = v.quad_count, "polygons"_a = v.polygon_count,
                                "disks"_a = v.disk_count, "spheres"_a = v.sphere_count,
                                "triangles"_a = v.primitive_count - others,
                                "dropped"_a = s.host().dropped);
            })
        .def_property_readonly("lights", [](const Scene& s) { return s.host().view.lights.count; })
        .def_property_readonly("tree",
                               [](const Scene& s) {
                                   const TreeInfo t = s.tree();
                                   if (t.width == 0) return py::dict();
                                   return py::dict("width"_a = t.width, "nodes"_a = t.nodes,
                                                   "references"_a = t.references,
                                                   "depth"_a = t.depth, "seconds"_a = t.seconds,
                                                   "memory"_a = t.memory, "cost"_a = t.cost,
                                                   "builder"_a = t.builder);
                               })
        .def_property_readonly("memory",
                               [](const Scene& s) { return s.host().memory() + s.tree().memory; });

    py::class_<Picture, std::shared_ptr<Picture>>(m, "Picture", py::module_local())
        .def(py::init<uint32_t, uint32_t, uint32_t, bool, int>(), "width"_a, "height"_a,
             "channels"_a, "integers"_a = false, "device"_a = 0)
        .def_property_readonly("width", &Picture::width)
        .def_property_readonly("height", &Picture::height)
        .def_property_readonly("memory", &Picture::memory)
        .def_property_readonly("mean_stderr", &Picture::mean_error)
        .def("image", &image_of)
        .def("stderr", &error_of)
        .def("view", &picture_view)
        .def("pointer", [](Picture& p) { return reinterpret_cast<uintptr_t>(p.share()); })
        .def("dlpack_device", &dlpack_device)
        .def("dlpack", &dlpack, "versioned"_a);

    py::class_<Film>(m, "Film", py::module_local())
        .def(py::init(&make_film), "width"_a, "height"_a, "device"_a = 0, "planes"_a = py::list())
        .def_property_readonly("width", &Film::width)
        .def_property_readonly("height", &Film::height)
        .def_property_readonly("samples", &Film::samples)
        .def_property_readonly("units", &Film::units)
        .def_property_readonly("memory", &Film::memory)
        .def("clear", &Film::clear, py::call_guard<Unlocked>())
        .def("add", py::overload_cast<const Film&>(&Film::add), "other"_a,
             py::call_guard<Unlocked>())
        .def("end_unit", &Film::end_unit, "samples"_a, py::call_guard<Unlocked>())
        .def("state", &state_of)
        .def("add_state", &add_state, "state"_a)
        .def(
            "resolve",
            [](const Film& f, const std::optional<Array<uint64_t>>& counts, bool units) {
                const auto p = make_picture(f, counts, 0, 0, units, nullptr);
                return py::make_tuple(copied(*p, &Picture::read_mean),
                                      copied(*p, &Picture::read_error));
            },
            "counts"_a = py::none(), "units"_a = false)
        .def("picture", &make_picture, "counts"_a = py::none(), "threads"_a = 0, "plane"_a = 0,
             "units"_a = false, "tail"_a = py::none())
        .def("sums",
             [](const Film& f) {
                 py::array_t<double> out(std::vector<py::ssize_t>{f.height(), f.width(), 3});
                 double* sums = out.mutable_data();
                 {
                     Unlocked unlocked;
                     f.sums(sums);
                 }
                 return out;
             })
        .def(
            "words",
            [](const Film& f, size_t plane) {
                if (plane >= f.planes().size()) throw py::value_error("no such plane");
                return words_of(f, plane);
            },
            "plane"_a = 0);

    using Rows3 = Array<double>;
    const auto mesh_view = [](const Rows3& vertices, const Array<uint32_t>& triangles) {
        need_shape(vertices, "vertices", {-1, 3});
        need_shape(triangles, "triangles", {-1, 3});
        return MeshView{vertices.data(), triangles.data(), static_cast<size_t>(vertices.shape(0)),
                        static_cast<size_t>(triangles.shape(0))};
    };
    m.def(
        "vertex_normals",
        [=](const Rows3& vertices, const Array<uint32_t>& triangles) {
            const MeshView mesh = mesh_view(vertices, triangles);
            py::array_t<double> out(std::vector<py::ssize_t>{vertices.shape(0), 3});
            double* normals = out.mutable_data();
            {
                Unlocked unlocked;
                vertex_normals(mesh, normals);
            }
            return out;
        },
        "vertices"_a, "triangles"_a);
    m.def(
        "read_obj",
        [](const py::bytes& text) -> py::object {
            ObjTables tables;
            const std::string_view view = text;
            bool whole;
            {
                Unlocked unlocked;
                whole = read_obj(view, tables);
            }
            if (!whole) return py::none();
            const auto rows = [](auto&& numbers, py::ssize_t width) {
                const auto n = static_cast<py::ssize_t>(numbers.size()) / width;
                return moved_array(std::move(numbers), {n, width});
            };
            const auto faces = static_cast<py::ssize_t>(tables.sides.size());
            return py::make_tuple(
                rows(std::move(tables.lines[0]), 3), rows(std::move(tables.lines[1]), 2),
                rows(std::move(tables.lines[2]), 3), rows(std::move(tables.corners), 3),
                moved_array(std::move(tables.sides), {faces}));
        },
        "text"_a);
    m.def(
        "read_rgbe",
        [](const py::bytes& lines, uint32_t width, uint32_t height) -> py::object {
            py::array_t<float> out(std::vector<py::ssize_t>{height, width, 3});
            float* const values = out.mutable_data();
            const std::string_view view = lines;
            bool whole;
            {
                Unlocked unlocked;
                whole = read_rgbe(view, width, height, values);
            }
            return whole ? py::object(std::move(out)) : py::none();
        },
        "lines"_a, "width"_a, "height"_a);
    m.def(
        "shading_of",
        [=](const Rows3& vertices, const Array<uint32_t>& triangles, const Rows3& normals) {
            const MeshView mesh = mesh_view(vertices, triangles);
            need_shape(normals, "normals", {vertices.shape(0), 3});
            const double* given = normals.data();
            Unlocked unlocked;
            const Shading found = shading_of(mesh, given);
            return std::pair(found.behind, found.flat);
        },
        "vertices"_a, "triangles"_a, "normals"_a);

    m.def(
        "render",
        [](const Scene& scene, Film& film, uint64_t seed, uint64_t sample_begin,
           uint64_t sample_end, int64_t max_depth, uint32_t rr_depth, const std::string& sampler,
           const std::string& scheduler, uint32_t threads, uint32_t batch, bool all_features,
           const py::object& poll, const std::optional<Array<uint32_t>>& pixels, bool units) {
            RenderSettings s;
            s.seed = seed;
            s.sample_begin = sample_begin;
            s.sample_end = sample_end;
            s.max_depth = max_depth;
            s.rr_depth = rr_depth;
            s.sampler = find_sampler(sampler);
            s.scheduler = scheduler;
            s.threads = threads;
            s.batch = batch;
            s.all_features = all_features;
            s.units = units;
            if (pixels) s.pixels = to_vector(*pixels);
            if (pixels && s.pixels.empty()) throw py::value_error("pixels is empty");
            return render_dict(scene, film, s, poll);
        },
        "scene"_a, "film"_a, py::kw_only(), "seed"_a = 0, "sample_begin"_a = 0, "sample_end"_a = 1,
        "max_depth"_a = -1, "rr_depth"_a = 5, "sampler"_a = "sobol", "scheduler"_a = "fused",
        "threads"_a = 0, "batch"_a = 0, "all_features"_a = false, "poll"_a = py::none(),
        "pixels"_a = py::none(), "units"_a = false);
    m.def(
        "render_features",
        [](const Scene& scene, Film& film, uint64_t seed, uint64_t sample_begin,
           uint64_t sample_end, const std::string& sampler, uint32_t threads, bool all_features,
           uint32_t first_row, const Array<double>& motion, const py::object& poll) {
            need_shape(motion, "motion", {2, 3, 4});
            FeatureSettings s;
            s.seed = seed;
            s.sample_begin = sample_begin;
            s.sample_end = sample_end;
            s.sampler = find_sampler(sampler);
            s.threads = threads;
            s.all_features = all_features;
            s.first_row = first_row;
            std::copy_n(motion.data(), motion.size(), &s.motion[0][0][0]);
            return features_dict(scene, film, s, poll);
        },
        "scene"_a, "film"_a, py::kw_only(), "seed"_a = 0, "sample_begin"_a = 0, "sample_end"_a = 1,
        "sampler"_a = "sobol", "threads"_a = 0, "all_features"_a = false, "first_row"_a = 0,
        "motion"_a, "poll"_a = py::none());
    m.def("put_features", &put_features, "scene"_a, "film"_a, py::kw_only(), "pictures"_a,
          "first_row"_a, "samples"_a, "threads"_a = 0, py::call_guard<Unlocked>());
}
