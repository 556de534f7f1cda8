// What the CUDA backend is and where it can run.
#include <thrust/version.h>

#include <atomic>
#include <cstdlib>

#include "backends/device.cuh"

namespace veriray {

BuildInfo build_info() {
    const std::string thrust = std::to_string(THRUST_MAJOR_VERSION) + "." +
                               std::to_string(THRUST_MINOR_VERSION) + "." +
                               std::to_string(THRUST_SUBMINOR_VERSION);
    const std::string toolkit =
        std::to_string(CUDART_VERSION / 1000) + "." + std::to_string(CUDART_VERSION % 1000 / 10);
    return {"cuda",
            "sm",
            "nvcc " + std::to_string(__CUDACC_VER_MAJOR__) + "." +
                std::to_string(__CUDACC_VER_MINOR__) + " with GCC " __VERSION__,
            thrust,
            toolkit,
            VR_CUDA_ARCHITECTURES,
            1};
}

namespace {
__global__ void probe_kernel() {}
}  // namespace

std::string why_unusable() {
    static std::atomic<bool> usable{false};  // and stays so
    if (usable) return "";
    const std::string toolkit =
        std::to_string(CUDART_VERSION / 1000) + "." + std::to_string(CUDART_VERSION % 1000 / 10);
    int driver = 0, count = 0;
    cudaDriverGetVersion(&driver);
    if (driver == 0) return "no NVIDIA driver found (libcuda.so.1)";
    const cudaError_t status = cudaGetDeviceCount(&count);
    if (status == cudaErrorInsufficientDriver)
        return "the driver supports CUDA " + std::to_string(driver / 1000) + "." +
               std::to_string(driver % 1000 / 10) + ", this build needs " + toolkit;
    const char* visible = std::getenv("CUDA_VISIBLE_DEVICES");
    if (status == cudaErrorNoDevice || (status == cudaSuccess && count == 0)) {
        cudaGetLastError();
        return visible ? "no device: CUDA_VISIBLE_DEVICES is '" + std::string(visible) + "'"
                       : "a driver, but no NVIDIA device";
    }
    if (status != cudaSuccess) {
        cudaGetLastError();
        return std::string("the driver answers ") + cudaGetErrorName(status) + " (" +
               cudaGetErrorString(status) + ")";
    }
    cudaFuncAttributes attributes{};
    const cudaError_t image = cudaFuncGetAttributes(&attributes, probe_kernel);
    if (image != cudaSuccess) {
        cudaGetLastError();
        return std::string("the code built for CUDA architectures " VR_CUDA_ARCHITECTURES
                           " cannot be loaded on the device: ") +
               cudaGetErrorName(image) + " (" + cudaGetErrorString(image) + ")";
    }
    usable = true;
    return "";
}

std::vector<DeviceInfo> devices() {
    std::vector<DeviceInfo> out;
    if (!why_unusable().empty()) return out;
    int count = 0, driver = 0;
    check(cudaGetDeviceCount(&count), "devices");
    check(cudaDriverGetVersion(&driver), "driver");
    int before = 0;
    check(cudaGetDevice(&before), "device");
    for (int i = 0; i < count; ++i) {
        cudaDeviceProp prop{};
        check(cudaGetDeviceProperties(&prop, i), "device");
        DeviceInfo d{};
        d.index = i;
        d.name = prop.name;
        d.compute_capability = std::to_string(prop.major) + "." + std::to_string(prop.minor);
        d.driver = std::to_string(driver / 1000) + "." + std::to_string(driver % 1000 / 10);
        d.multiprocessors = prop.multiProcessorCount;
        size_t free = 0, total = prop.totalGlobalMem;
        // Another process may have taken it, or all of its memory: then none is free.
        if (cudaSetDevice(i) != cudaSuccess || cudaMemGetInfo(&free, &total) != cudaSuccess) {
            cudaGetLastError();
            free = 0;
        }
        d.memory_free = free + DevicePool::of(i).idle();
        d.memory_total = total;
        out.push_back(d);
    }
    check(cudaSetDevice(before), "device");
    return out;
}

}  // namespace veriray
