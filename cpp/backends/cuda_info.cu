// What the CUDA backend is and where it can run; its parts by name for the test suite.
#include <thrust/version.h>

#include <cstdlib>

#include "backends/device.cuh"
#include "backends/hooks.h"
#include "core/rng.h"

namespace veriray {

// ---- what is here ----
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
        check(cudaSetDevice(i), "device");
        size_t free = 0, total = 0;
        check(cudaMemGetInfo(&free, &total), "device memory");
        d.memory_free = free;
        d.memory_total = total;
        out.push_back(d);
    }
    check(cudaSetDevice(before), "device");
    return out;
}

// ---- hooks of the test suite ----
namespace {
__global__ void function_kernel(uint32_t which, uint32_t inputs, uint32_t outputs, const float* x,
                                float* y, uint64_t n) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < n) evaluate<Scalar>(which, x + i * inputs, y + i * outputs);
}

__global__ void random_kernel(uint64_t seed, Sampler sampler, const uint32_t* pixel,
                              const uint64_t* sample, const uint32_t* block, uint32_t* out,
                              uint64_t n) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i >= n) return;
    const RandomKey key = random_key(seed, static_cast<uint32_t>(sample[i] >> 32), sampler);
    const Block<uint32_t> r =
        random_block(key, pixel[i], static_cast<uint32_t>(sample[i]), block[i]);
    out[4 * i] = r.x, out[4 * i + 1] = r.y, out[4 * i + 2] = r.z, out[4 * i + 3] = r.w;
}
}  // namespace

std::pair<size_t, size_t> function_shape(const std::string& name) {
    const FunctionInfo& f = kFunctions[find_function(name)];
    return {f.inputs, f.outputs};
}

std::vector<float> eval_function(const std::string& name, const std::vector<float>& x) {
    const uint32_t which = find_function(name);
    const FunctionInfo& f = kFunctions[which];
    use_device(0);
    const uint64_t n = x.size() / f.inputs;
    Buffer<float> in(x, "arguments"), out(n * f.outputs, "values");
    if (n)
        function_kernel<<<blocks_for(n, 256), 256>>>(which, f.inputs, f.outputs, in.get(),
                                                     out.get(), n);
    check_launch("function");
    return out.download();
}

std::vector<uint32_t> random_words(uint64_t seed, Sampler sampler,
                                   const std::vector<uint32_t>& pixel,
                                   const std::vector<uint64_t>& sample,
                                   const std::vector<uint32_t>& block) {
    use_device(0);
    Buffer<uint32_t> p(pixel, "arguments"), b(block, "arguments"), out(4 * pixel.size(), "values");
    Buffer<uint64_t> s(sample, "arguments");
    if (!pixel.empty())
        random_kernel<<<blocks_for(pixel.size(), 256), 256>>>(seed, sampler, p.get(), s.get(),
                                                              b.get(), out.get(), pixel.size());
    check_launch("random");
    return out.download();
}

}  // namespace veriray
