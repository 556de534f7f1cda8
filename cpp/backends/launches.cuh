// What the schedulers of the CUDA backend have in common.
#pragma once

#include <cuda_runtime.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <map>
#include <mutex>
#include <thread>

#include "backends/block_ledger.cuh"
#include "backends/device.cuh"
#include "backends/instances.h"
#include "backends/spare.h"
#include "integrators/integrators.h"
#include "scene/thread_pool.h"

namespace veriray {

using Clock = std::chrono::steady_clock;
inline double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

// A stream of the current device, which does not wait for the default one.
struct Stream {
    cudaStream_t s;
    int device = current_device();
    Stream() : s(DevicePool::of(current_device()).take_stream()) {
        if (!s) check(cudaStreamCreateWithFlags(&s, cudaStreamNonBlocking), "stream");
    }
    ~Stream() {
        if (in_child()) return;
        if (std::uncaught_exceptions() == 0)
            DevicePool::of(device).give(s);
        else
            cudaStreamDestroy(s);
    }
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;
};

// What a scheduler is given beside the job. Work goes to stream `work`; words are read and written
// through `side` meanwhile.
struct Launches {
    int device;
    const SceneView& scene;
    const RenderSettings& s;
    RenderStats& stats;
    int multiprocessors;
    Stream& work;
    Stream& side;
    Scratch<uint64_t>& ledger;
    size_t picture;  // numbers of the film's means
    const Poll& poll;
};

// Each returns false if poll stopped it.
bool render_fused(const Launches& l, const Job& job);
bool render_thrust(const Launches& l, const Job& job);
bool render_wavefront(const Launches& l, const Job& job);

// Notes what the kernel that traces takes; returns its resident blocks on a multiprocessor.
inline int note_kernel(RenderStats& stats, const void* kernel, uint32_t block) {
    static std::mutex mutex;
    static std::map<std::pair<const void*, int>, KernelUse> known;
    const std::pair key(kernel, current_device());
    const std::lock_guard lock(mutex);
    if (const auto found = known.find(key); found != known.end()) {
        stats.kernel = found->second;
    } else {
        cudaFuncAttributes use{};
        int per_sm = 0;
        check(cudaFuncGetAttributes(&use, kernel), "kernel");
        check(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&per_sm, kernel,
                                                            static_cast<int>(block), 0),
              "occupancy");
        stats.kernel = {static_cast<uint32_t>(use.numRegs),
                        static_cast<uint32_t>(use.localSizeBytes),
                        static_cast<uint32_t>(per_sm) * block};
        known[key] = stats.kernel;
    }
    return static_cast<int>(stats.kernel.resident_threads / block);
}

template <class... Arguments>
int note_kernel(RenderStats& stats, void (*kernel)(Arguments...), uint32_t block) {
    return note_kernel(stats, reinterpret_cast<const void*>(kernel), block);
}

// A device word as it is now.
template <class T>
T read_word(const T* word, const Stream& side) {
    T value{};
    check(cudaMemcpyAsync(&value, word, sizeof value, cudaMemcpyDeviceToHost, side.s), "read");
    check(cudaStreamSynchronize(side.s), "read");
    return value;
}

// Asks poll every kPollPause while the device works, and gets memory for the picture ready; where
// poll stops the render, the device's word *cancel is raised.
class Watch {
   public:
    Watch(const Launches& l, uint32_t* cancel) : l_(l), cancel_(cancel) {}

    // query() until what it asks for is done; share() is the part of the work that is.
    template <class Query, class Share>
    void wait(Query query, Share share) {
        for (const Clock::time_point begin = Clock::now();;) {
            const cudaError_t status = query();
            if (status == cudaSuccess) return;
            if (status != cudaErrorNotReady) check(status, "render");
            cudaGetLastError();  // not ready is no error of a later launch
            if (l_.poll && !stopped_ && Clock::now() - last_ > kPollPause)
                ask(share());
            else if (!Spare::common().touch(l_.picture))
                pause(Clock::now() - begin);
        }
    }
    bool stopped() const { return stopped_; }
    // After all work: false if poll stopped it; throws what poll threw.
    bool complete() const {
        if (error_) std::rethrow_exception(error_);
        return !stopped_;
    }

   private:
    static constexpr std::chrono::milliseconds kBusy{20};

    const Launches& l_;
    uint32_t* cancel_;
    Clock::time_point last_ = Clock::now();
    bool stopped_ = false;
    std::exception_ptr error_;

    // Leaves the processor to others for a 256th of the time that was waited, if that is long.
    static void pause(Clock::duration waited) {
        if (waited < kBusy)
            std::this_thread::yield();
        else
            std::this_thread::sleep_for(std::min<Clock::duration>(waited / 256, kPollPause));
    }
    void ask(double share) {
        try {
            stopped_ = !keeping_device([&] { return l_.poll(std::min(1.0, share)); });
        } catch (...) {
            error_ = std::current_exception();
            stopped_ = true;
        }
        last_ = Clock::now();
        if (!stopped_) return;
        const uint32_t yes = 1;
        check(cudaMemcpyAsync(cancel_, &yes, sizeof yes, cudaMemcpyHostToDevice, l_.side.s),
              "cancel");
        check(cudaStreamSynchronize(l_.side.s), "cancel");
    }
};

}  // namespace veriray
