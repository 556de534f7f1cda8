// References are divided by the surface-area heuristic, one thread per node, so the tree depends
// only on the input.
#include "scene/bvh_build.h"

#include <atomic>
#include <bit>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>

#include "scene/bvh_spatial.h"
#include "scene/thread_pool.h"
#include "scene/tree_layout.h"

namespace veriray {
namespace {

using namespace bvh;

constexpr uint32_t kMaxRefs = 1u << 27;  // what a leaf of a wide node can address
constexpr uint32_t kLeafRefs = 2;        // or a block's number, if no triangle is split
constexpr uint32_t kGrain = 2048;        // smaller subtrees stay on their thread
constexpr float kFarthest = 0x1p60f;     // coordinates whose products stay finite

// If no triangle is split, the references are first counted in a grid of one cell for every
// kCellRefs of them, and nodes of more than kFewCells occupied cells are divided between cells.
// J. Pantaleoni, D. Luebke, "HLBVH: Hierarchical LBVH Construction for Real-Time Ray Tracing of
// Dynamic Geometry", HPG 2010.
constexpr uint32_t kCellRefs = 4, kFewCells = 128;

// A triangle is split only if all of these hold. In the scene, a line through the scene's box meets
// on average more than kNeedless boxes of triangles because the triangles do not fill them. In the
// node, the children of the best division of references overlap by kOverlap of the scene's surface.
// The split costs less than kPatience times that division, since one split makes the next ones
// cheaper. References grow by at most 30 % or kFreeRefs, and never to more than twice the
// primitives.
constexpr double kNeedless = 2;
constexpr float kOverlap = 1e-4f;
constexpr float kPatience = 1.15f;
constexpr uint32_t kFreeRefs = 1u << 16;

// A node to be divided: references [first, last), room up to `end`; nodes below it start at `free`.
struct Range {
    uint32_t node, first, last, end, depth, free;
    Box centres;
    uint32_t size() const { return last - first; }
};

// Runs work(range) on `threads` threads for ranges pushed by any of them, the largest first, while
// the calling thread polls every 50 ms. Exceptions propagate.
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
    void run(uint32_t threads, const std::function<void()>& poll, Work work) {
        std::vector<std::thread> pool;
        pool.reserve(threads);
        std::unique_lock lock(mutex_);
        try {
            for (uint32_t k = 0; k < threads; ++k)
                pool.emplace_back([&] {
                    throw_once();
                    drain(work);
                });
        } catch (const std::exception&) {         // of resources or of memory
            if (pool.empty()) throw NoThreads();  // fewer threads than asked for do the same work
        }
        while (!done_.wait_for(lock, std::chrono::milliseconds(50),
                               [&] { return stop_ || open_ == 0; })) {
            lock.unlock();
            std::exception_ptr error;
            try {
                poll();
            } catch (...) {
                error = std::current_exception();
            }
            lock.lock();
            if (error) stop(error);
        }
        lock.unlock();
        for (std::thread& t : pool) t.join();
        if (error_) std::rethrow_exception(error_);
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

struct Survey {
    Box box, centres;
    double needless = 0;  // half surface of boxes that their triangles do not fill
};

Survey survey(const TreeInput& in) {
    Survey out;
    for (uint32_t i = 0; i < in.count; ++i) {
        float lo[3], hi[3];
        in.box(i, lo, hi);
        for (int k = 0; k < 3; ++k)
            if (!(-kFarthest <= lo[k] && lo[k] <= hi[k] && hi[k] <= kFarthest))
                throw std::invalid_argument("the box of primitive " + std::to_string(i) +
                                            " is empty or not finite");
        const Box b{load3(lo), load3(hi)};
        out.box.grow(b);
        out.centres.grow(b.lo + b.hi, b.lo + b.hi);
        if (i >= in.triangles) continue;
        const float* t = in.records + static_cast<size_t>(i) * kRecordFloats;
        out.needless += static_cast<double>(b.half_area() - filled_half_area(t));
    }
    return out;
}

// While the tree grows, nodes have fixed places apart from each other, so threads need not
// coordinate: a node of r references has at most 2 r - 2 nodes below it.
class Builder {
   public:
    Builder(const TreeInput& in, const WalkCost& walk) : count_(in.count), spatial_(in.records) {
        const uint32_t n = count_;
        const Survey all = survey(in);
        const float area = all.box.half_area();
        const bool split = all.needless > kNeedless * static_cast<double>(area);
        const uint32_t more = split ? std::max(n / 10 * 3, std::min(n, kFreeRefs)) : 0;
        Range range{0, 0, n, std::min(kMaxRefs, n + more), 0, 1, {}};
        overlap_ = kOverlap * area;
        leaf_ = split ? kLeafRefs : std::max(kLeafRefs, walk.block_size);
        refs_ = std::unique_ptr<Ref[]>(new Ref[range.end]);
        use_large_pages(refs_.get(), range.end * sizeof(Ref));
        nodes_ = std::unique_ptr<BinaryNode[]>(new BinaryNode[2 * static_cast<size_t>(range.end)]);
        set_box(nodes_[0], all.box);
        const auto ref = [&](uint32_t i) {
            float lo[3], hi[3];
            in.box(i, lo, hi);
            return Ref{load3(lo, Ref::primitive_bits(i)),
                       load3(hi, split && i < in.triangles ? 1.f : 0.f)};
        };
        uint32_t side = 1;
        while (!split && side * side * side <= n / kCellRefs) ++side;
        sort(range, Bins(all.centres, side), ref);
    }

    BuiltBvh run(uint32_t threads, const BuildPoll& progress) {
        const auto poll = [&] {
            go_on(progress, std::min(1.0, static_cast<double>(finished_) / count_));
        };
        if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
        pool_.run(std::min(threads, count_ / kGrain + 1), poll, [this](Range r) {
            r.centres = {};
            for (uint32_t i = r.first; i < r.last; ++i)
                r.centres.grow(refs_[i].centre(), refs_[i].centre());
            build(r);
        });
        BuiltBvh out;
        pool_.push({});
        pool_.run(1, poll, [&](const Range&) { gather(out); });
        return out;
    }

   private:
    // Sorts the references ref(0), ref(1) ... by the cells of a grid.
    template <class Reference>
    void sort(Range root, const Bins& grid, Reference ref) {
        const uint32_t side = grid.count;
        const auto cell = [&](const Ref& r) {
            const Int4 b = grid(r.centre());
            return static_cast<uint32_t>(b[0]) +
                   side * (static_cast<uint32_t>(b[1]) + side * static_cast<uint32_t>(b[2]));
        };
        std::vector<Box> box(side * side * side);
        std::vector<uint32_t> next(box.size());
        for (uint32_t i = 0; i < count_; ++i) {
            const Ref r = ref(i);
            const uint32_t c = cell(r);
            box[c].grow(r.lo, r.hi);
            ++next[c];
        }
        std::vector<Cell> cells;
        root.centres = {};
        for (uint32_t c = 0; c < box.size(); ++c) {
            if (next[c] == 0) continue;
            const Float4 at{static_cast<float>(c % side), static_cast<float>(c / side % side),
                            static_cast<float>(c / side / side), 0.f};
            cells.push_back({box[c].lo, box[c].hi, at, c, static_cast<int32_t>(next[c])});
            root.centres.grow(at, at);
        }
        box = {};
        divide_cells(root, cells.data(), static_cast<uint32_t>(cells.size()), next.data());
        for (uint32_t i = 0; i < count_; ++i) {
            const Ref r = ref(i);
            refs_[next[cell(r)]++] = r;
        }
    }

    // next[cell]: the place of its first reference.
    void divide_cells(Range r, Cell* cells, uint32_t n, uint32_t* next) {
        while (n > kFewCells && r.size() > kGrain && !deep(r)) {
            const Bins bins(r.centres, Bins::enough(n));
            const Split best = binned_split(cells, n, bins);
            if (best.axis < 0) break;
            Sides sides = partition(cells, n, best, bins);
            Cell* const middle = cells + sides.middle;
            sides.middle = 0;
            for (const Cell* c = cells; c < middle; ++c)
                sides.middle += static_cast<uint32_t>(c->references);
            Range right;
            divide(r, right, sides);
            divide_cells(right, middle, n - static_cast<uint32_t>(middle - cells), next);
            n = static_cast<uint32_t>(middle - cells);
        }
        uint32_t at = r.first;
        for (uint32_t i = 0; i < n; ++i) {
            next[cells[i].number] = at;
            at += static_cast<uint32_t>(cells[i].references);
        }
        pool_.push(r);
    }

    // From here on, halving just keeps to the allowed depth.
    static bool deep(const Range& r) {
        return r.depth + std::bit_width(r.size() - 1) >= kMaxBvhDepth;
    }

    // Nodes and slots in depth-first order.
    void gather(BuiltBvh& out) const {
        struct Item {
            uint32_t from, to, depth;
        };
        std::vector<Item> stack{{0, 0, 0}};
        out.order.reserve(count_);
        out.nodes.reserve(count_);
        out.nodes.push_back(nodes_[0]);
        while (!stack.empty() && !pool_.stopped()) {
            const Item at = stack.back();
            stack.pop_back();
            out.depth = std::max(out.depth, at.depth);
            const uint32_t from = nodes_[at.from].left_or_first, count = nodes_[at.from].count;
            const uint32_t slot = static_cast<uint32_t>(out.order.size());
            const uint32_t to = static_cast<uint32_t>(out.nodes.size());
            out.nodes[at.to].left_or_first = count > 0 ? slot : to;
            for (uint32_t i = from; i < from + count; ++i)
                out.order.push_back(refs_[i].primitive());
            if (count > 0) continue;
            out.nodes.push_back(nodes_[from]);
            out.nodes.push_back(nodes_[from + 1]);
            stack.push_back({from + 1, to + 1, at.depth + 1});
            stack.push_back({from, to, at.depth + 1});
        }
    }

    // Returns the place for the next nodes.
    uint32_t build(Range r) {
        while (r.size() > leaf_) {
            if (pool_.stopped()) return r.free;
            Range right;
            divide(r, right, split(r));
            if (right.size() >= kGrain) {
                pool_.push(right);
            } else {
                right.free = r.free;
                r.free = build(right);
            }
        }
        nodes_[r.node].left_or_first = r.first;
        nodes_[r.node].count = r.size();
        finished_.fetch_add(r.size(), std::memory_order_relaxed);
        return r.free;
    }

    // Turns `left` into the left child of the node that it was.
    void divide(Range& left, Range& right, const Sides& sides) {
        const uint32_t middle = left.first + sides.middle;
        const uint32_t n = left.last - middle, shift = room(sides, left.end - left.last);
        const uint32_t start = middle + shift, moved = std::min(shift, n);
        std::copy_n(&refs_[middle], moved, &refs_[left.last + shift - moved]);
        const uint32_t pair = left.free;
        nodes_[left.node].left_or_first = pair;
        nodes_[left.node].count = 0;
        set_box(nodes_[pair], sides.box[0]);
        set_box(nodes_[pair + 1], sides.box[1]);
        const uint32_t depth = left.depth + 1;
        right = {pair + 1,        start, start + n,
                 left.end,        depth, left.free + 2 * (start - left.first),
                 sides.centres[1]};
        left = {pair, left.first, middle, start, depth, pair + 2, sides.centres[0]};
    }

    // The left child's part of `room`, shared by surface.
    static uint32_t room(const Sides& s, uint32_t room) {
        const float a = s.box[0].half_area(), b = s.box[1].half_area();
        if (!(a + b > 0.f)) return room / 2;
        return std::min(room, static_cast<uint32_t>(a / (a + b) * static_cast<float>(room)));
    }

    Sides split(Range& r) {
        Ref* refs = &refs_[r.first];
        uint32_t n = r.size();
        if (deep(r)) return halves(r);
        if (n <= kSwept) return swept_split(refs, n);
        const Bins bins(r.centres, Bins::enough(n));
        const Split best = binned_split(refs, n, bins);
        if (n < r.end - r.first && (best.axis < 0 || overlaps(best.box))) {
            const SpatialSplit spatial =
                spatial_.find(refs, n, r.end - r.last, box(nodes_[r.node]));
            if (spatial.cost < best.cost * kPatience) {
                const Sides sides = spatial_.partition(refs, n, r.end - r.last, spatial);
                r.last = r.first + n;
                return sides.middle > 0 && sides.middle < n ? sides : halves(r);
            }
        }
        return best.axis >= 0 ? partition(refs, n, best, bins) : halves(r);
    }

    Sides halves(const Range& r) {
        const Float4 width = r.centres.hi - r.centres.lo;
        const int xy = width[1] > width[0];
        return median_split(&refs_[r.first], r.size(), width[2] > width[xy] ? 2 : xy);
    }

    static Box box(const BinaryNode& n) { return {load3(n.lo), load3(n.hi)}; }

    bool overlaps(const Box* b) const {
        const Float4 e = min4(b[0].hi, b[1].hi) - max4(b[0].lo, b[1].lo);
        return e[0] >= 0.f && e[1] >= 0.f && e[2] >= 0.f &&
               e[0] * (e[1] + e[2]) + e[1] * e[2] > overlap_;
    }

    const uint32_t count_;
    const Spatial spatial_;
    float overlap_;
    uint32_t leaf_;
    std::unique_ptr<Ref[]> refs_;
    std::unique_ptr<BinaryNode[]> nodes_;
    std::atomic<uint64_t> finished_{0};
    Pool pool_;
};

}  // namespace

void go_on(const BuildPoll& poll, double share) {
    if (poll && !poll(share)) throw std::runtime_error("the building of a tree was stopped");
}

BuiltBvh build_bvh(const TreeInput& in, const WalkCost& walk, uint32_t threads,
                   const BuildPoll& progress) {
    if (in.count > kMaxRefs)
        throw std::invalid_argument(std::to_string(in.count) +
                                    " primitives; a tree holds at most 2^27");
    if (in.count == 0) return {};
    const auto start = std::chrono::steady_clock::now();
    BuiltBvh out = Builder(in, walk).run(threads, progress);
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return out;
}

}  // namespace veriray
