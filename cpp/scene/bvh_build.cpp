#include "scene/bvh_build.h"

#include <atomic>
#include <bit>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <system_error>
#include <thread>

#include "scene/bvh_split.h"

namespace veriray {
namespace {

using namespace bvh;

constexpr uint32_t kMaxRefs = 1u << 27;  // what a wide node's leaf can address
constexpr uint32_t kLeafRefs = 2;
constexpr uint32_t kGrain = 2048;  // smaller subtrees stay on their thread

// A node to be divided: references [first, last), room up to `end`.
struct Range {
    uint32_t node, first, last, end, depth;
    Box centres;
    uint32_t size() const { return last - first; }
};

// Runs work(range) for ranges pushed by anyone, the largest first, on `threads` threads, while the
// calling one polls. Exceptions propagate; returns false if stopped.
class Pool {
   public:
    bool stopped() const { return stop_; }

    void push(const Range& r) {
        const std::lock_guard lock(mutex_);
        heap_.push_back(r);
        std::push_heap(heap_.begin(), heap_.end(), smaller);
        ++open_;
        changed_.notify_one();
    }

    template <class Work>
    bool run(uint32_t threads, const std::function<bool()>& poll, Work work) {
        std::vector<std::thread> pool;
        pool.reserve(threads);
        std::unique_lock lock(mutex_);
        try {
            for (uint32_t k = 0; k < threads; ++k) pool.emplace_back([&] { drain(work); });
        } catch (const std::system_error&) {
            if (pool.empty()) throw;  // fewer threads than asked for do the same work
        }
        while (!done_.wait_for(lock, std::chrono::milliseconds(50),
                               [&] { return stop_ || open_ == 0; })) {
            lock.unlock();
            std::exception_ptr error;
            bool go_on = true;
            try {
                go_on = poll();
            } catch (...) {
                error = std::current_exception();
            }
            lock.lock();
            if (!go_on || error) stop(error);
        }
        lock.unlock();
        for (std::thread& t : pool) t.join();
        if (error_) std::rethrow_exception(error_);
        return !stop_;
    }

   private:
    static bool smaller(const Range& a, const Range& b) { return a.size() < b.size(); }

    void stop(const std::exception_ptr& error) {  // under the lock
        if (!error_) error_ = error;
        stop_ = true;
        changed_.notify_all();
        done_.notify_all();
    }

    template <class Work>
    void drain(Work& work) {
        std::unique_lock lock(mutex_);
        for (;;) {
            changed_.wait(lock, [&] { return stop_ || open_ == 0 || !heap_.empty(); });
            if (stop_ || open_ == 0) return;
            std::pop_heap(heap_.begin(), heap_.end(), smaller);
            const Range r = heap_.back();
            heap_.pop_back();
            lock.unlock();
            std::exception_ptr error;
            try {
                work(r);
            } catch (...) {
                error = std::current_exception();
            }
            lock.lock();
            if (error) stop(error);
            if (--open_ == 0) changed_.notify_all(), done_.notify_all();
        }
    }

    std::mutex mutex_;
    std::condition_variable changed_, done_;
    std::vector<Range> heap_;
    uint64_t open_ = 0;  // ranges waited for
    std::atomic<bool> stop_{false};
    std::exception_ptr error_;
};

void set_box(BinaryNode& node, const Box& box) {
    for (int k = 0; k < 3; ++k) node.lo[k] = box.lo[k], node.hi[k] = box.hi[k];
}

// Nodes stand apart while the tree grows, at places that no thread has to ask for: the children of
// a node whose right child's references start at m are nodes 2 m - 1 and 2 m.
class Builder {
   public:
    Builder(const float* lo, const float* hi, uint32_t n)
        : count_(n), refs_(new Ref[n]), nodes_(new BinaryNode[2 * static_cast<size_t>(n)]) {
        Range all{0, 0, n, n, 0, {}};
        Box box;
        for (uint32_t i = 0; i < n; ++i) {
            Ref& r = refs_[i];
            r.lo = Float4{lo[3 * i], lo[3 * i + 1], lo[3 * i + 2], 0.f};
            r.hi = Float4{hi[3 * i], hi[3 * i + 1], hi[3 * i + 2], 0.f};
            r.set_primitive(i);
            box.grow(r.lo, r.hi);
            all.centres.grow(r.centre(), r.centre());
        }
        set_box(nodes_[0], box);
        pool_.push(all);
    }

    bool run(uint32_t threads, const std::function<bool(double)>& progress) {
        return pool_.run(
            std::max(1u, std::min(threads, count_ / kGrain)),
            [&] { return !progress || progress(static_cast<double>(finished_) / count_); },
            [this](const Range& r) { build(r); });
    }

    // Nodes and slots in depth-first order.
    BuiltBvh result() const {
        BuiltBvh out;
        out.order.reserve(count_);
        out.nodes.reserve(count_);
        struct Item {
            uint32_t from, to, depth;
        };
        std::vector<Item> stack{{0, 0, 0}};
        out.nodes.push_back(nodes_[0]);
        while (!stack.empty()) {
            const Item at = stack.back();
            stack.pop_back();
            BinaryNode& node = out.nodes[at.to];
            const uint32_t from = node.left_or_first;
            out.depth = std::max(out.depth, at.depth);
            if (node.count > 0) {
                node.left_or_first = static_cast<uint32_t>(out.order.size());
                for (uint32_t i = 0; i < node.count; ++i)
                    out.order.push_back(refs_[from + i].primitive());
                std::sort(out.order.end() - node.count, out.order.end());
                continue;
            }
            const uint32_t to = static_cast<uint32_t>(out.nodes.size());
            node.left_or_first = to;
            out.nodes.push_back(nodes_[from]);
            out.nodes.push_back(nodes_[from + 1]);
            stack.push_back({from + 1, to + 1, at.depth + 1});
            stack.push_back({from, to, at.depth + 1});
        }
        return out;
    }

   private:
    void build(Range r) {
        while (r.size() > kLeafRefs) {
            if (pool_.stopped()) return;
            Range right;
            divide(r, right);
            if (right.size() >= kGrain)
                pool_.push(right);
            else
                build(right);
        }
        nodes_[r.node].left_or_first = r.first;
        nodes_[r.node].count = r.size();
        finished_.fetch_add(r.size(), std::memory_order_relaxed);
    }

    // Makes `left` the left child of what it was.
    void divide(Range& left, Range& right) {
        const Sides sides = split(left);
        const uint32_t middle = left.first + sides.middle, pair = 2 * middle - 1;
        nodes_[left.node].left_or_first = pair;
        nodes_[left.node].count = 0;
        set_box(nodes_[pair], sides.box[0]);
        set_box(nodes_[pair + 1], sides.box[1]);
        const uint32_t depth = left.depth + 1;
        right = {pair + 1, middle, left.last, left.end, depth, sides.centres[1]};
        left = {pair, left.first, middle, middle, depth, sides.centres[0]};
    }

    Sides split(const Range& r) {
        Ref* refs = refs_.get() + r.first;
        const uint32_t n = r.size();
        const Float4 width = r.centres.hi - r.centres.lo;
        // From here on halves are just deep enough.
        const bool deep = r.depth + std::bit_width(n - 1) >= kMaxBvhDepth;
        if (!deep && n <= kSwept) return swept_split(refs, n);
        if (!deep) {
            const Bins bins(r.centres, n);
            const Split best = binned_split(refs, n, bins);
            if (best.axis >= 0) return partition(refs, n, best, bins);
        }
        const int xy = width[1] > width[0];
        return median_split(refs, n, width[2] > width[xy] ? 2 : xy);
    }

    const uint32_t count_;
    std::unique_ptr<Ref[]> refs_;
    std::unique_ptr<BinaryNode[]> nodes_;
    std::atomic<uint64_t> finished_{0};
    Pool pool_;
};

}  // namespace

BuiltBvh build_bvh(const float* lo, const float* hi, const float* triangle_vertices, uint32_t n,
                   uint32_t threads, const std::function<bool(double)>& progress) {
    (void)triangle_vertices;
    if (n > kMaxRefs)
        throw std::invalid_argument(std::to_string(n) + " primitives; a tree holds at most 2^27");
    if (n == 0) return {};
    const auto start = std::chrono::steady_clock::now();
    Builder builder(lo, hi, n);
    if (!builder.run(threads, progress)) return {};
    BuiltBvh out = builder.result();
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return out;
}

}  // namespace veriray
