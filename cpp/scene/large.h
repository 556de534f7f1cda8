// Large tables whose pages the threads that fill them touch first.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <new>
#include <utility>
#include <vector>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace veriray {

// Requests large pages, if the system has them, for memory that has not been touched yet.
inline void use_large_pages([[maybe_unused]] const void* memory, [[maybe_unused]] size_t bytes) {
#if defined(__linux__)
    constexpr size_t kPage = 1u << 21;
    const size_t from = reinterpret_cast<size_t>(memory);
    const size_t first = (from + kPage - 1) / kPage * kPage, last = (from + bytes) / kPage;
    if (first < last * kPage)
        madvise(reinterpret_cast<void*>(first), last * kPage - first, MADV_HUGEPAGE);
#endif
}

// Memory of zeros from the system, which elements without an initial value leave as it is.
template <class T>
struct ZeroedMemory {
    using value_type = T;
    ZeroedMemory() = default;
    template <class U>
    ZeroedMemory(const ZeroedMemory<U>&) noexcept {}
    T* allocate(size_t n) {
        void* const p = std::calloc(n, sizeof(T));
        if (!p) throw std::bad_alloc();
        use_large_pages(p, n * sizeof(T));
        return static_cast<T*>(p);
    }
    void deallocate(T* p, size_t) noexcept { std::free(p); }
    template <class U, class... Args>
    void construct(U* p, Args&&... args) {
        if constexpr (sizeof...(Args) > 0)
            ::new (static_cast<void*>(p)) U(std::forward<Args>(args)...);
    }
    bool operator==(const ZeroedMemory&) const { return true; }
};

// A vector of numbers or plain records; the first resize() makes zeros without touching them.
template <class T>
using Large = std::vector<T, ZeroedMemory<T>>;

}  // namespace veriray
