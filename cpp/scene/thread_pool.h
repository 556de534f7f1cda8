// Work on several threads while the calling one polls.
#pragma once

#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <new>
#include <thread>
#include <utility>
#include <vector>

namespace veriray {

struct NoThreads : std::bad_alloc {
    const char* what() const noexcept override { return "no thread can be started"; }
};

// A thread's first exception allocates memory for thread-local data; if that fails, the C library
// ends the process. So every thread throws one exception before it starts to work.
inline void throw_once() {
    try {
        throw 0;
    } catch (int) {
    }
}

// Address space for throw_once: a thread's first memory comes from the system, not from the heap.
class Reserve {
   public:
    Reserve() = default;
    Reserve(const Reserve&) = delete;
    Reserve& operator=(const Reserve&) = delete;
    ~Reserve() { release(); }
    bool take() {
        at_ = mmap(nullptr, kBytes, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
        return at_ != MAP_FAILED;
    }
    void release() {
        if (at_ != MAP_FAILED) munmap(at_, kBytes);
        at_ = MAP_FAILED;
    }

   private:
    static constexpr size_t kBytes = 1 << 16;
    void* at_ = MAP_FAILED;
};

// Threads for one loop, or for many loops one after another, between which they wait: to start 16
// threads takes as long as the work of many a loop.
class Team {
   public:
    explicit Team(bool stays) : stays_(stays) {}
    Team(const Team&) = delete;
    Team& operator=(const Team&) = delete;
    ~Team() {
        {
            const std::lock_guard lock(mutex_);
            stays_ = false;
        }
        wake_.notify_all();
        for (std::thread& t : threads_) t.join();
    }
    // Lets threads run body(k) once for k from 0 on, at most that many, fewer if the system gives
    // no more; returns how many. body has ended in all of them before the next start().
    uint32_t start(uint32_t most, const std::function<void(uint32_t)>& body) {
        const uint32_t waiting = std::min(most, static_cast<uint32_t>(threads_.size()));
        if (waiting) {
            {
                const std::lock_guard lock(mutex_);
                body_ = &body, count_ = waiting, ++round_;
            }
            wake_.notify_all();
        }
        try {
            reserves_.reserve(most), threads_.reserve(most);
            while (threads_.size() < most) {
                auto reserve = std::make_unique<Reserve>();
                if (!reserve->take()) break;
                reserves_.push_back(std::move(reserve));
                threads_.emplace_back(&Team::work, this, static_cast<uint32_t>(threads_.size()),
                                      round_, &body, reserves_.back().get());
            }
        } catch (const std::exception&) {  // of resources or of memory
        }
        return std::min(most, static_cast<uint32_t>(threads_.size()));
    }

   private:
    std::mutex mutex_;
    std::condition_variable wake_;
    std::vector<std::thread> threads_;
    std::vector<std::unique_ptr<Reserve>> reserves_;
    const std::function<void(uint32_t)>* body_ = nullptr;
    uint32_t count_ = 0;
    uint64_t round_ = 0;
    bool stays_;

    void work(uint32_t k, uint64_t seen, const std::function<void(uint32_t)>* body,
              Reserve* reserve) {
        reserve->release();
        throw_once();
        for (;;) {
            (*body)(k);
            std::unique_lock lock(mutex_);
            wake_.wait(lock, [&] { return !stays_ || (round_ != seen && k < count_); });
            if (!stays_) return;
            seen = round_, body = body_;
        }
    }
};

// The team of this thread while make() runs; its loops then start no threads of their own.
inline Team*& team_here() {
    static thread_local Team* team = nullptr;
    return team;
}
template <class Make>
auto with_team(Make make) {
    struct Here {
        Team team{true};
        Team* const before = std::exchange(team_here(), &team);
        ~Here() { team_here() = before; }
    } here;
    return make();
}

// How often work asks whether to go on.
inline constexpr std::chrono::milliseconds kPollPause{10};

// Runs work(worker, unit) for units [0, units) on `threads` threads; poll(share) every kPollPause
// on the calling thread, which stops the rest by returning false or throwing. Exceptions propagate.
// Returns false if stopped. Runs on fewer threads if the system gives no more; throws NoThreads if
// it gives none.
template <class Work>
bool parallel(uint32_t threads, uint64_t units, const std::function<bool(double)>& poll,
              Work work) {
    std::atomic<uint64_t> next{0};
    std::atomic<bool> stop{false};
    std::mutex mutex;
    std::condition_variable done;
    uint32_t ended = 0;
    std::exception_ptr error;
    const auto fail = [&] {
        const std::lock_guard lock(mutex);
        if (!error) error = std::current_exception();
        stop = true;
    };
    const std::function<void(uint32_t)> body = [&](uint32_t worker) {
        try {
            for (uint64_t unit; !stop && (unit = next++) < units;) work(worker, unit);
        } catch (...) {
            fail();
        }
        const std::lock_guard lock(mutex);
        ++ended;
        done.notify_one();
    };
    throw_once();
    Team own(false);
    Team* const kept = std::exchange(team_here(), nullptr);  // not for what poll begins
    const uint32_t most = static_cast<uint32_t>(std::min<uint64_t>(threads, units)),
                   running = (kept ? kept : &own)->start(most, body);
    if (running) {
        std::unique_lock lock(mutex);
        while (!done.wait_for(lock, kPollPause, [&] { return ended == running; })) {
            if (!poll) continue;
            lock.unlock();
            const double share =
                static_cast<double>(std::min(next.load(), units)) / static_cast<double>(units);
            try {
                if (!poll(share)) stop = true;
            } catch (...) {
                fail();
            }
            lock.lock();
        }
    }
    team_here() = kept;
    if (most && !running) throw NoThreads();
    if (error) std::rethrow_exception(error);
    return !stop;
}

inline constexpr uint32_t kAllThreads = 0;

// Runs work(first, last) for pieces of [0, n) on at most `threads` threads, each of which has
// enough to do to be worth its start; exceptions propagate.
template <class Work>
void in_chunks(uint32_t threads, size_t n, Work work) {
    constexpr size_t kGrain = 4096, kLeast = 2 * kGrain;
    if (threads == kAllThreads) threads = std::max(1u, std::thread::hardware_concurrency());
    if (n <= kGrain || threads == 1) return work(size_t{0}, n);
    const auto chunk = [&](uint32_t, uint64_t k) {
        work(static_cast<size_t>(k) * kGrain, std::min<size_t>(n, (k + 1) * kGrain));
    };
    parallel(static_cast<uint32_t>(std::min<size_t>(threads, n / kLeast + 1)),
             (n + kGrain - 1) / kGrain, {}, chunk);
}

// Whether fits(i) holds for all of [0, n); without branches and, from `many` on, by threads.
template <class Fits>
bool all_fit(size_t n, Fits fits, size_t many = 1 << 18) {
    std::atomic<bool> all{true};
    in_chunks(n < many ? 1 : kAllThreads, n, [&](size_t first, size_t last) {
        bool good = true;
        for (size_t i = first; i < last; ++i) good = good & fits(i);
        if (!good) all = false;
    });
    return all;
}

// The numbers i of [0, n), in order, of which fits(i) holds; calls it once for each.
template <class Fits>
std::vector<uint32_t> where(size_t n, Fits fits) {
    constexpr size_t kPart = 1 << 13;
    std::vector<std::vector<uint32_t>> parts((n + kPart - 1) / kPart);
    const auto look = [&](uint32_t, uint64_t part) {
        const size_t first = part * kPart, last = std::min(n, first + kPart);
        std::vector<uint32_t> found;
        found.reserve(last - first);
        for (size_t i = first; i < last; ++i)
            if (fits(i)) found.push_back(static_cast<uint32_t>(i));
        parts[part].assign(found.begin(), found.end());
    };
    if (parts.size() < 2)
        for (size_t k = 0; k < parts.size(); ++k) look(0, k);
    else
        parallel(std::max(1u, std::thread::hardware_concurrency()), parts.size(), {}, look);
    size_t count = 0;
    for (const auto& part : parts) count += part.size();
    std::vector<uint32_t> all;
    all.reserve(count);
    for (const auto& part : parts) all.insert(all.end(), part.begin(), part.end());
    return all;
}

}  // namespace veriray
