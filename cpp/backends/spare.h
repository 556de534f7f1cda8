// Memory of the host for the next picture. Systems hand out pages more slowly than a GPU's link
// fills them (a millisecond for 3 MB), so they are touched while the device works.
#pragma once

#include <algorithm>
#include <cstddef>
#include <mutex>
#include <new>

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
        if (numbers_.size() != numbers) {
            numbers_ = {}, touched_ = 0;
            try {
                numbers_.resize(numbers);
            } catch (const std::bad_alloc&) {
                return false;
            }
        }
        if (touched_ >= numbers) return false;
        const size_t end = std::min(numbers, touched_ + kStep);
        for (volatile float* all = numbers_.data(); touched_ < end; touched_ += kPage)
            all[touched_] = 0;
        return true;
    }
    Large<float> take(size_t numbers) {
        const std::unique_lock lock(mutex_, std::try_to_lock);
        Large<float> out;
        if (lock && numbers_.size() == numbers) {
            std::swap(out, numbers_);
            touched_ = 0;
        } else {
            out.resize(numbers);
        }
        return out;
    }

   private:
    static constexpr size_t kPage = 4096 / sizeof(float), kStep = 8 * kPage, kMost = 1 << 25;

    std::mutex mutex_;
    Large<float> numbers_;
    size_t touched_ = 0;
};

}  // namespace veriray
