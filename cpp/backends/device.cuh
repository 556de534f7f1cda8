// Device memory, errors and launch sizes of the CUDA backend.
#pragma once

#include <cuda_runtime.h>

#include <string>
#include <utility>
#include <vector>

#include "api/renderer.h"

namespace veriray {

[[noreturn]] inline void out_of_memory(const std::string& what_needs) {
    cudaGetLastError();
    size_t free = 0, total = 0;
    cudaMemGetInfo(&free, &total);
    throw OutOfMemoryError(what_needs + " of device memory, " + std::to_string(free) + " are free");
}

inline void check(cudaError_t status, const char* what) {
    if (status == cudaSuccess) return;
    if (status == cudaErrorMemoryAllocation)
        out_of_memory(std::string(what) + ": needs more bytes");
    cudaGetLastError();
    throw DeviceError(std::string(what) + ": " + cudaGetErrorName(status) + " (" +
                      cudaGetErrorString(status) + ")");
}

inline void check_launch(const char* what) { check(cudaGetLastError(), what); }

// Device memory of one owner.
template <class T>
class Buffer {
   public:
    Buffer() = default;
    Buffer(size_t n, const char* what) : n_(n) {
        if (n == 0) return;
        const cudaError_t status = cudaMalloc(reinterpret_cast<void**>(&p_), n * sizeof(T));
        if (status == cudaErrorMemoryAllocation)
            out_of_memory(std::string(what) + ": needs " + std::to_string(n * sizeof(T)) +
                          " bytes");
        check(status, what);
    }
    Buffer(const T* from, size_t n, const char* what) : Buffer(n, what) {
        if (n) check(cudaMemcpy(p_, from, n * sizeof(T), cudaMemcpyHostToDevice), what);
    }
    template <class Memory>
    Buffer(const std::vector<T, Memory>& v, const char* what) : Buffer(v.data(), v.size(), what) {}
    Buffer(Buffer&& o) noexcept : p_(o.p_), n_(o.n_) { o.p_ = nullptr, o.n_ = 0; }
    Buffer& operator=(Buffer&& o) noexcept {
        std::swap(p_, o.p_);
        std::swap(n_, o.n_);
        return *this;
    }
    ~Buffer() { cudaFree(p_); }
    T* get() const { return p_; }
    size_t size() const { return n_; }
    void zero() {
        if (n_) check(cudaMemset(p_, 0, n_ * sizeof(T)), "clear");
    }
    std::vector<T> download() const { return download(0, n_); }
    std::vector<T> download(size_t first, size_t n) const {
        std::vector<T> out(n);
        download(first, n, out.data());
        return out;
    }
    void download(size_t first, size_t n, T* out) const {
        if (n) check(cudaMemcpy(out, p_ + first, n * sizeof(T), cudaMemcpyDeviceToHost), "copy");
    }

   private:
    T* p_ = nullptr;
    size_t n_ = 0;
};

inline void use_device(int device) {
    const std::string why = why_unusable();
    if (!why.empty()) throw DeviceError(why);
    check(cudaSetDevice(device), ("device " + std::to_string(device)).c_str());
}

inline unsigned blocks_for(uint64_t n, uint32_t block) {
    return static_cast<unsigned>((n + block - 1) / block);
}

template <class Body>
__global__ void each_of_kernel(const __grid_constant__ Body body, uint64_t n) {
    const uint64_t i = static_cast<uint64_t>(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < n) body(i);
}

// body(i) for i in [0, n), which is done when it returns.
template <class Body>
void each_of(uint64_t n, const Body& body, const char* what) {
    if (n) each_of_kernel<<<blocks_for(n, 256), 256>>>(body, n);
    check_launch(what);
    check(cudaDeviceSynchronize(), what);
}

}  // namespace veriray
