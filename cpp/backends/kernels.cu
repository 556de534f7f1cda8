// Kernels that were compiled at run time.
#include "backends/kernels.cuh"

#include <map>
#include <mutex>

#include "backends/device.cuh"

namespace veriray {
namespace {

using Key = std::pair<int, FeatureMask>;

// All that were added. A library is never unloaded: a render may be using it.
struct Added {
    std::mutex mutex;
    std::map<Key, const void*> fused;
    std::map<Key, WaveKernels> waves;
};
Added& added() {
    static Added* const kept = new Added;  // renders may outlive static objects
    return *kept;
}

template <class Map>
auto* find(Map& map, const Key& key) {
    const std::lock_guard lock(added().mutex);
    const auto at = map.find(key);
    return at == map.end() ? nullptr : &at->second;
}

}  // namespace

const void* fused_kernel_for(int device, FeatureMask features) {
    const auto* found = find(added().fused, {device, features});
    return found ? *found : nullptr;
}
const WaveKernels* wave_kernels_for(int device, FeatureMask features) {
    return find(added().waves, {device, features});
}

#if CUDART_VERSION >= 12080
void add_kernels(int device, FeatureMask features, const std::string& code) {
    constexpr const char* kWhat = "kernels made at run time";
    use_device(device);
    cudaLibrary_t library{};
    check(cudaLibraryLoadData(&library, code.data(), nullptr, nullptr, 0, nullptr, nullptr, 0),
          kWhat);
    // Null where the library has none of that name.
    const auto kernel = [&](const std::string& name) -> const void* {
        cudaKernel_t found{};
        const cudaError_t status = cudaLibraryGetKernel(&found, library, name.c_str());
        if (status == cudaSuccess) return found;
        cudaGetLastError();
        if (status != cudaErrorSymbolNotFound) check(status, kWhat);
        return nullptr;
    };
    const void* const fused = kernel("veriray_fused");
    WaveKernels wave{features,
                     kernel("veriray_refill"),
                     kernel("veriray_trace"),
                     kernel("veriray_shadow"),
                     kernel("veriray_scatter"),
                     {}};
#define VR_SCATTER(name) wave.scatter[kKind##name] = kernel("veriray_scatter_" #name);
    VR_CLOSURES(VR_SCATTER)
#undef VR_SCATTER
    const bool waves = wave.refill && wave.trace && wave.shadow && wave.scatter_all;
    if (!fused && !waves) throw DeviceError(std::string(kWhat) + ": not these");
    const std::lock_guard lock(added().mutex);
    if (fused) added().fused.emplace(Key{device, features}, fused);
    if (waves) added().waves.emplace(Key{device, features}, wave);
}
#else
void add_kernels(int, FeatureMask, const std::string&) {
    throw DeviceError("kernels made at run time need a build with CUDA 12.8 or later");
}
#endif

}  // namespace veriray
