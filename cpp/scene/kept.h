// What costly pure functions gave, for the scenes that follow: a moved camera or another colour
// asks for the same again.
#pragma once

#include <cstddef>
#include <map>
#include <mutex>

namespace veriray {

// At most so many values by key. Never waits: a process that was forked may find the lock taken for
// good, and makes its values anew.
template <class Key, class Value>
class Kept {
   public:
    explicit Kept(size_t most) : most_(most) {}
    template <class Make>
    Value operator()(const Key& key, Make make) {
        if (const std::unique_lock lock(mutex_, std::try_to_lock); lock)
            if (const auto at = values_.find(key); at != values_.end()) return at->second;
        Value made = make();
        if (const std::unique_lock lock(mutex_, std::try_to_lock); lock) {
            if (values_.size() >= most_) values_.clear();
            values_.try_emplace(key, made);
        }
        return made;
    }

   private:
    std::mutex mutex_;
    std::map<Key, Value> values_;
    size_t most_;
};

}  // namespace veriray
