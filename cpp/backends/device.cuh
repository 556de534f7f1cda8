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
    Buffer(const std::vector<T>& v, const char* what) : Buffer(v.size(), what) {
        if (n_) check(cudaMemcpy(p_, v.data(), n_ * sizeof(T), cudaMemcpyHostToDevice), what);
    }
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
        if (n)
            check(cudaMemcpy(out.data(), p_ + first, n * sizeof(T), cudaMemcpyDeviceToHost),
                  "copy");
        return out;
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

}  // namespace veriray
