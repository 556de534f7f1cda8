// Device memory, errors and launch sizes of the CUDA backend.
#pragma once

#include <cuda_runtime.h>

#include <exception>
#include <string>
#include <utility>
#include <vector>

#include "api/renderer.h"
#include "backends/device_pool.cuh"

namespace veriray {

inline int current_device() {
    int device = 0;
    cudaGetDevice(&device);
    return device;
}

[[noreturn]] inline void out_of_memory(const std::string& what_needs) {
    cudaGetLastError();
    DevicePool::of(current_device()).trim();
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

// All work of the default stream, on which memory is cleared and filled; other streams do not wait
// for it.
inline void wait_for_default(const char* what) { check(cudaStreamSynchronize(nullptr), what); }

// Device memory of one owner. kPooled: from the pool and back to it, so its owner has waited for
// the work that uses it; the driver waits itself where an exception ends that work.
template <class T, bool kPooled = false>
class Buffer {
   public:
    Buffer() = default;
    Buffer(size_t n, const char* what) : n_(n) {
        if (n == 0) return;
        in_child();
        size_t bytes = n * sizeof(T);
        if (kPooled) {
            bytes = DevicePool::rounded(bytes);
            device_ = current_device();
            p_ = static_cast<T*>(DevicePool::of(device_).take(bytes));
        }
        bytes_ = bytes;
        if (p_) return;
        cudaError_t status = allocate();
        if (status == cudaErrorMemoryAllocation && DevicePool::of(current_device()).idle()) {
            cudaGetLastError();
            DevicePool::of(current_device()).trim();
            status = allocate();
        }
        if (status == cudaErrorMemoryAllocation)
            out_of_memory(std::string(what) + ": needs " + std::to_string(n * sizeof(T)) +
                          " bytes");
        check(status, what);
    }
    Buffer(const T* from, size_t n, const char* what) : Buffer(n, what) {
        const size_t bytes = n * sizeof(T);
        if (Staging::send(current_device(), reinterpret_cast<char*>(p_),
                          reinterpret_cast<const char*>(from), bytes))
            return;
        if (n) check(cudaMemcpy(p_, from, bytes, cudaMemcpyHostToDevice), what);
        // A small copy may still be under way when cudaMemcpy returns. Scratch memory is for work
        // on streams that do not wait for the default one; scenes wait once for all their tables.
        if (n && kPooled) wait_for_default(what);
    }
    template <class Memory>
    Buffer(const std::vector<T, Memory>& v, const char* what) : Buffer(v.data(), v.size(), what) {}
    Buffer(Buffer&& o) noexcept { *this = std::move(o); }
    Buffer& operator=(Buffer&& o) noexcept {
        std::swap(p_, o.p_);
        std::swap(n_, o.n_);
        std::swap(bytes_, o.bytes_);
        std::swap(device_, o.device_);
        return *this;
    }
    ~Buffer() {
        if (!p_ || in_child()) return;
        if (kPooled && std::uncaught_exceptions() == 0)
            DevicePool::of(device_).give(p_, bytes_);
        else
            cudaFree(p_);
    }
    // To the system, not to the pool, when the device has done all work.
    void free() {
        if (p_ && !in_child()) cudaFree(p_);
        p_ = nullptr, n_ = bytes_ = 0;
    }
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
    size_t n_ = 0, bytes_ = 0;
    int device_ = 0;

    cudaError_t allocate() { return cudaMalloc(reinterpret_cast<void**>(&p_), bytes_); }
};
template <class T>
using Scratch = Buffer<T, true>;

inline void use_device(int device) {
    const std::string why = why_unusable();
    if (!why.empty()) throw DeviceError(why);
    check(cudaSetDevice(device), ("device " + std::to_string(device)).c_str());
}

// fn(), after which this thread has the device that it had: what asks a caller may use others.
template <class Fn>
auto keeping_device(const Fn& fn) {
    struct Keep {
        int device = current_device();
        ~Keep() { cudaSetDevice(device); }
    };
    const Keep keep;
    return fn();
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
    wait_for_default(what);
}

}  // namespace veriray
