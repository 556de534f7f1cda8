// What renders on a device take in turns: memory, streams and page-locked memory. Taking them from
// the driver anew for each render takes longer than a small picture.
#pragma once

#include <cuda_runtime.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <exception>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "scene/thread_pool.h"

namespace veriray {

// Whether this is a child of the process that first asked: CUDA does not work there, and a lock may
// be held by a thread that is not there. What is destroyed in a child is left alone.
inline bool in_child() {
    static const pid_t first = getpid();
    return getpid() != first;
}

// Idle memory and streams of one device. Whoever gives something back has waited until the device
// is done with it.
class DevicePool {
   public:
    static DevicePool& of(int device) {
        static std::mutex mutex;
        // Never destroyed: the driver may be gone before static objects are.
        static auto& pools = *new std::vector<std::unique_ptr<DevicePool>>;
        const std::lock_guard lock(mutex);
        const size_t k = static_cast<size_t>(std::max(0, device));
        if (pools.size() <= k) pools.resize(k + 1);
        if (!pools[k]) pools[k].reset(new DevicePool(device));
        return *pools[k];
    }

    // Sizes that blocks have: a request of a similar size then finds them.
    static size_t rounded(size_t bytes) {
        const size_t unit = bytes <= 1 << 20 ? 1 << 10 : 1 << 21;
        return (bytes + unit - 1) / unit * unit;
    }
    // An idle block of `bytes` to a quarter more, which `bytes` then tells; null: none.
    void* take(size_t& bytes) {
        const std::lock_guard lock(mutex_);
        auto best = blocks_.end();
        for (auto b = blocks_.begin(); b != blocks_.end(); ++b)
            if (b->bytes >= bytes && b->bytes <= bytes + bytes / 4 &&
                (best == blocks_.end() || b->bytes < best->bytes))
                best = b;
        if (best == blocks_.end()) return nullptr;
        const Block found = *best;
        blocks_.erase(best);
        idle_ -= found.bytes;
        bytes = found.bytes;
        return found.at;
    }
    // Keeps the block, unless it is larger than all that is kept; the oldest go.
    void give(void* at, size_t bytes) noexcept {
        std::vector<Block> free;
        try {
            const std::lock_guard lock(mutex_);
            free.reserve(blocks_.size() + 1);
            blocks_.push_back({at, bytes});
            idle_ += bytes;
            while (idle_ > most_) {
                free.push_back(blocks_.front());
                idle_ -= blocks_.front().bytes;
                blocks_.erase(blocks_.begin());
            }
        } catch (const std::bad_alloc&) {
            cudaFree(at);
        }
        for (const Block& b : free) cudaFree(b.at);
    }
    // Gives all idle memory back to the driver.
    void trim() {
        std::vector<Block> free;
        {
            const std::lock_guard lock(mutex_);
            free.swap(blocks_);
            idle_ = 0;
        }
        for (const Block& b : free) cudaFree(b.at);
    }
    // Bytes that it keeps.
    size_t most() const { return most_; }
    size_t idle() const {
        const std::lock_guard lock(mutex_);
        return idle_;
    }

    cudaStream_t take_stream() {
        const std::lock_guard lock(mutex_);
        if (streams_.empty()) return nullptr;
        const cudaStream_t s = streams_.back();
        streams_.pop_back();
        return s;
    }
    void give(cudaStream_t stream) noexcept {
        try {
            const std::lock_guard lock(mutex_);
            streams_.push_back(stream);
        } catch (const std::bad_alloc&) {
            cudaStreamDestroy(stream);
        }
    }

   private:
    struct Block {
        void* at;
        size_t bytes;
    };
    mutable std::mutex mutex_;
    std::vector<Block> blocks_;  // oldest first
    std::vector<cudaStream_t> streams_;
    size_t idle_ = 0, most_ = 0;

    // Keeps a 64th of the device's memory: on one of 16 GiB a film of 1920 x 1080 pixels and its
    // picture.
    explicit DevicePool(int device) {
        cudaDeviceProp prop{};
        if (cudaGetDeviceProperties(&prop, device) == cudaSuccess)
            most_ = prop.totalGlobalMem / 64;
        else
            cudaGetLastError();
    }
};

// Copies between the host's memory and the device's by way of page-locked memory, which several
// threads fill or empty: a GPU's link is faster than one thread.
class Staging {
   public:
    // To the host. False: it is not worth the threads, there is no page-locked memory to be had, or
    // the device failed; what is in `out` is of no use. The device's work on `from` is done.
    static bool fetch(int device, char* out, const char* from, size_t bytes) {
        return with_one(device, bytes, kLeastFetched, [&](Staging& s) {
            cudaError_t status = cudaSuccess;
            for (size_t at = 0; at < bytes && status == cudaSuccess; at += kPart * kParts)
                status =
                    s.window(device, out + at, from + at, std::min(bytes - at, kPart * kParts));
            return status;
        });
    }
    // To the device, likewise; what is there is complete when it returns.
    static bool send(int device, char* out, const char* from, size_t bytes) {
        return with_one(device, bytes, kLeastSent,
                        [&](Staging& s) { return s.stream(device, out, from, bytes); });
    }
    ~Staging() {
        if (stream_) cudaStreamDestroy(stream_);
        for (cudaEvent_t e : events_)
            if (e) cudaEventDestroy(e);
        if (at_) cudaFreeHost(at_);
    }

   private:
    // Bytes from which on it is worth its threads. What is fetched has its pages (spare.h).
    static constexpr size_t kLeastSent = 2 << 20, kLeastFetched = 8 << 20;
    static constexpr size_t kPart = 1 << 20, kParts = 16;

    int device_ = 0;
    char* at_ = nullptr;
    cudaStream_t stream_ = nullptr;
    cudaEvent_t events_[kParts] = {};

    // Whether so many bytes are worth it, there is one and use(it) succeeds; then it is for others.
    template <class Use>
    static bool with_one(int device, size_t bytes, size_t least, Use use) {
        if (bytes < least) return false;
        std::unique_ptr<Staging> s = take(device);
        if (!s) return false;
        if (use(*s) != cudaSuccess) return cudaGetLastError(), false;
        const std::lock_guard lock(mutex());
        idle().push_back(std::move(s));
        return true;
    }
    // move(any, k) for k in [0, parts) on several threads, which begin in this order.
    template <class Move>
    static void each(size_t parts, uint32_t most, Move move) {
        try {
            const uint32_t threads = std::clamp(std::thread::hardware_concurrency(), 1u, most);
            parallel(static_cast<uint32_t>(std::min<size_t>(threads, parts)), parts, {}, move);
        } catch (const NoThreads&) {
            for (size_t k = 0; k < parts; ++k) move(0, k);
        }
    }
    static std::mutex& mutex() {
        static std::mutex m;
        return m;
    }
    static std::vector<std::unique_ptr<Staging>>& idle() {
        static auto& all = *new std::vector<std::unique_ptr<Staging>>;
        return all;
    }
    static std::unique_ptr<Staging> take(int device) {
        {
            const std::lock_guard lock(mutex());
            for (auto& s : idle())
                if (s->device_ == device) {
                    std::swap(s, idle().back());
                    std::unique_ptr<Staging> found = std::move(idle().back());
                    idle().pop_back();
                    return found;
                }
        }
        std::unique_ptr<Staging> made(new Staging);
        made->device_ = device;
        bool ok =
            cudaMallocHost(reinterpret_cast<void**>(&made->at_), kPart * kParts) == cudaSuccess &&
            cudaStreamCreateWithFlags(&made->stream_, cudaStreamNonBlocking) == cudaSuccess;
        for (cudaEvent_t& e : made->events_)
            ok = ok && cudaEventCreateWithFlags(&e, cudaEventDisableTiming) == cudaSuccess;
        if (ok) return made;
        cudaGetLastError();
        return nullptr;
    }
    cudaError_t window(int device, char* out, const char* from, size_t bytes) {
        const size_t parts = (bytes + kPart - 1) / kPart;
        const auto size = [&](size_t k) { return std::min(kPart, bytes - k * kPart); };
        for (size_t k = 0; k < parts; ++k) {
            const cudaError_t status = cudaMemcpyAsync(at_ + k * kPart, from + k * kPart, size(k),
                                                       cudaMemcpyDeviceToHost, stream_);
            if (status != cudaSuccess) return cudaStreamSynchronize(stream_), status;
            if (cudaEventRecord(events_[k], stream_) != cudaSuccess)
                return cudaStreamSynchronize(stream_);
        }
        std::atomic<cudaError_t> status{cudaSuccess};
        const auto move = [&](uint32_t, uint64_t k) {
            cudaSetDevice(device);
            const cudaError_t done = cudaEventSynchronize(events_[k]);
            if (done != cudaSuccess) status = done;
            std::memcpy(out + k * kPart, at_ + k * kPart, size(k));
        };
        each(parts, 4, move);
        return status;
    }
    // Parts take the page-locked memory in turns: each waits until the one before it there has been
    // handed to the device, and for the device's copy of that.
    cudaError_t stream(int device, char* out, const char* from, size_t bytes) {
        const size_t parts = (bytes + kPart - 1) / kPart;
        std::atomic<size_t> turns[kParts] = {};
        std::atomic<cudaError_t> status{cudaSuccess};
        const auto note = [&](cudaError_t one) {
            if (one != cudaSuccess) status = one;
        };
        each(parts, 8, [&](uint32_t, uint64_t k) {
            const size_t place = k % kParts, turn = k / kParts;
            while (turns[place] != turn) std::this_thread::yield();
            if (status == cudaSuccess) {
                cudaSetDevice(device);
                if (turn) note(cudaEventSynchronize(events_[place]));
                const size_t size = std::min(kPart, bytes - k * kPart);
                std::memcpy(at_ + place * kPart, from + k * kPart, size);
                note(cudaMemcpyAsync(out + k * kPart, at_ + place * kPart, size,
                                     cudaMemcpyHostToDevice, stream_));
                note(cudaEventRecord(events_[place], stream_));
            }
            turns[place] = turn + 1;
        });
        note(cudaStreamSynchronize(stream_));
        return status;
    }
};

}  // namespace veriray
