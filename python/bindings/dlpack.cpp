// Pictures for other packages, without a copy: DLPack (https://dmlc.github.io/dlpack), whose
// structures and names of capsules are stated here.
#include "bindings.h"

namespace {

struct DLDevice {
    int32_t kind, number;
};
constexpr int32_t kHost = 1, kCuda = 2;

struct DLTensor {
    void* data;
    DLDevice device;
    int32_t ndim;
    uint8_t type_code, type_bits;
    uint16_t type_lanes;
    int64_t* shape;
    int64_t* strides;  // in elements; null: rows in C order
    uint64_t byte_offset;
};
constexpr uint8_t kFloat = 2;

struct Managed {
    DLTensor tensor;
    void* context;
    void (*deleter)(Managed*);
    static constexpr const char *kName = "dltensor", *kUsed = "used_dltensor";
};

struct ManagedVersioned {
    uint32_t major, minor;
    void* context;
    void (*deleter)(ManagedVersioned*);
    uint64_t flags;  // 1: read-only, 2: copied
    DLTensor tensor;
    static constexpr const char *kName = "dltensor_versioned", *kUsed = "used_dltensor_versioned";
};

DLDevice device_of(const Picture& p) {
    const bool host = build_info().backend == "cpu";
    return {host ? kHost : kCuda, host ? 0 : p.device()};
}

// What a capsule points to; keeps the picture. Who takes the capsule renames it and calls the
// deleter once, on any thread, with or without Python's lock.
template <class M>
struct Lent {
    M managed{};
    std::shared_ptr<Picture> picture;
    int64_t shape[3], strides[3];

    explicit Lent(const std::shared_ptr<Picture>& p)
        : picture(p),
          shape{p->height(), p->width(), p->channels()},
          strides{shape[2] * shape[1], shape[2], 1} {
        managed.tensor = {p->share(), device_of(*p), 3, kFloat, 32, 1, shape, strides, 0};
        managed.context = this;
        managed.deleter = [](M* m) { delete static_cast<Lent*>(m->context); };
    }
};

template <class M>
py::capsule lend(std::unique_ptr<Lent<M>> lent) {
    const py::capsule out(&lent->managed, M::kName, [](PyObject* capsule) {
        if (PyCapsule_IsValid(capsule, M::kName)) {  // nobody took it
            auto* m = static_cast<M*>(PyCapsule_GetPointer(capsule, M::kName));
            m->deleter(m);
        }
    });
    lent.release();
    return out;
}

}  // namespace

py::array picture_view(const std::shared_ptr<Picture>& picture) {
    if (device_of(*picture).kind != kHost)
        throw py::value_error("the picture is in memory of a GPU");
    auto keep = std::make_unique<std::shared_ptr<Picture>>(picture);
    const py::capsule owner(keep.get(),
                            [](void* p) { delete static_cast<std::shared_ptr<Picture>*>(p); });
    keep.release();
    py::array_t<float> out(
        {static_cast<py::ssize_t>(picture->height()), static_cast<py::ssize_t>(picture->width()),
         static_cast<py::ssize_t>(picture->channels())},
        picture->share(), owner);
    out.attr("setflags")(false);
    return out;
}

py::tuple dlpack_device(const Picture& picture) {
    const DLDevice device = device_of(picture);
    return py::make_tuple(device.kind, device.number);
}

py::capsule dlpack(const std::shared_ptr<Picture>& picture, bool versioned) {
    if (!versioned) return lend(std::make_unique<Lent<Managed>>(picture));
    auto lent = std::make_unique<Lent<ManagedVersioned>>(picture);
    lent->managed.major = 1;
    lent->managed.flags = device_of(*picture).kind == kHost ? 1 : 0;
    return lend(std::move(lent));
}
