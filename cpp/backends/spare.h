// Memory of the host for the next picture. Systems hand out pages more slowly than a GPU's link
// fills them (a millisecond for 3 MB), so those of earlier pictures are kept, and new ones are
// touched while the device works.
#pragma once

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <mutex>
#include <new>
#include <utility>
#include <vector>

#include "scene/large.h"

namespace veriray {

// No thread waits for another one: whoever finds it in use does without.
class Spare {
   public:
    static Spare& common() {
        static auto& spare = *new Spare;  // threads may outlive static objects
        return spare;
    }
    // Touches some more of the pages of a picture of so many numbers; whether it had to.
    bool touch(size_t numbers) {
        const std::unique_lock lock(mutex_, std::try_to_lock);
        if (!lock || numbers > kMost) return false;
        auto found = find(numbers);
        if (found == blocks_.end()) {
            try {
                blocks_.push_back({Large<float>(numbers), 0});
            } catch (const std::bad_alloc&) {
                return false;
            }
            bound();
            found = std::prev(blocks_.end());
        }
        if (found->touched >= numbers) return false;
        const size_t end = std::min(numbers, found->touched + kStep);
        for (volatile float* all = found->numbers.data(); found->touched < end;
             found->touched += kPage)
            all[found->touched] = 0;
        return true;
    }
    Large<float> take(size_t numbers) {
        const std::unique_lock lock(mutex_, std::try_to_lock);
        const auto found = lock ? find(numbers) : blocks_.end();
        if (!lock || found == blocks_.end()) return Large<float>(numbers);
        Large<float> out = std::move(found->numbers);
        blocks_.erase(found);
        return out;
    }
    // Keeps the memory of a picture that nobody holds any longer; the oldest goes.
    void give(Large<float> numbers) noexcept {
        const std::unique_lock lock(mutex_, std::try_to_lock);
        if (!lock || numbers.size() > kMost) return;
        const size_t touched = numbers.size();
        try {
            blocks_.push_back({std::move(numbers), touched});
        } catch (const std::bad_alloc&) {
            return;
        }
        bound();
    }

   private:
    static constexpr size_t kPage = 4096 / sizeof(float), kStep = 8 * kPage, kMost = 1 << 25;
    struct Block {
        Large<float> numbers;
        size_t touched;
    };

    std::mutex mutex_;
    std::vector<Block> blocks_;  // oldest first

    // The last one, which caches may still hold.
    std::vector<Block>::iterator find(size_t numbers) {
        const auto found = std::find_if(blocks_.rbegin(), blocks_.rend(), [&](const Block& b) {
            return b.numbers.size() == numbers;
        });
        return found == blocks_.rend() ? blocks_.end() : std::prev(found.base());
    }
    void bound() {
        size_t all = 0;
        for (const Block& b : blocks_) all += b.numbers.size();
        for (; all > kMost; blocks_.erase(blocks_.begin())) all -= blocks_[0].numbers.size();
    }
};

}  // namespace veriray
