#include "scene/ploc.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <stdexcept>
#include <utility>

#include "scene/thread_pool.h"

namespace veriray {
namespace {

class HostExec {
   public:
    static constexpr uint32_t kRounds = 1, kFew = 0;

    HostExec(uint32_t threads, const BuildPoll& poll) : threads_(threads), poll_(poll) {}

    void* memory(size_t bytes) {
        memory_ = std::unique_ptr<Line[]>(new Line[bytes / sizeof(Line) + 1]);
        return memory_.get();
    }
    template <class Body>
    void each(uint32_t n, const Body& body) {
        in_chunks(threads_, n, [&](size_t first, size_t last) {
            for (size_t i = first; i < last; ++i) body(static_cast<uint32_t>(i));
        });
    }
    template <class Body, class Join, class T>
    void reduce(uint32_t n, const Body& body, const Join& join, T all, T* out) {
        for (uint32_t i = 0; i < n; ++i) all = join(all, body(i));
        *out = all;
    }
    const uint32_t* sort(uint32_t n, uint32_t, uint64_t* const* keys, uint32_t* const* values) {
        std::vector<std::pair<uint64_t, uint32_t>> pairs(n);
        for (uint32_t i = 0; i < n; ++i) pairs[i] = {keys[0][i], values[0][i]};
        std::sort(pairs.begin(), pairs.end());  // the values ascend
        for (uint32_t i = 0; i < n; ++i) values[1][i] = pairs[i].second;
        return values[1];
    }
    template <class Flag>
    void sum(uint32_t n, const Flag& flag, uint32_t* out) {
        for (uint32_t i = 0, before = 0; i < n; ++i) {
            out[i] = before;
            before += flag(i);
        }
    }
    void clear(uint32_t* p, size_t n) { std::fill_n(p, n, 0u); }
    template <class T>
    T read(const T* p) {
        return *p;
    }
    void progress(double share) { go_on(poll_, share); }

   private:
    struct alignas(64) Line {
        char bytes[64];
    };
    uint32_t threads_;
    const BuildPoll& poll_;
    std::unique_ptr<Line[]> memory_;
};

}  // namespace

template <uint32_t N>
WideTree<N> build_ploc(const TreeInput& in, WalkCost walk, uint32_t threads,
                       const BuildPoll& progress) {
    WideTree<N> out{{empty_wide_node<N>()}, std::vector<uint32_t>(in.count)};
    if (in.count == 0) return out;
    const auto start = std::chrono::steady_clock::now();
    HostExec exec(threads, progress);
    ploc::Builder<N, HostExec> builder(exec, in, walk);
    const ploc::Node<N> root = builder.merge();
    out.nodes.resize(std::max(1u, root.row.wide[0]));
    builder.emit(root, out.nodes.data(), out.order.data());
    out.depth = root.depth;
    out.cost = tree_cost(root.row, root.lo, root.hi);
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    return out;
}
template WideTree<2> build_ploc(const TreeInput&, WalkCost, uint32_t, const BuildPoll&);
template WideTree<4> build_ploc(const TreeInput&, WalkCost, uint32_t, const BuildPoll&);
template WideTree<8> build_ploc(const TreeInput&, WalkCost, uint32_t, const BuildPoll&);
template WideTree<16> build_ploc(const TreeInput&, WalkCost, uint32_t, const BuildPoll&);

}  // namespace veriray
