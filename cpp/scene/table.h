// A table of a scene's form, shared by copies of the form until one of them makes it anew.
#pragma once

#include <cstddef>
#include <memory>

#include "scene/large.h"

namespace veriray {

template <class T>
class Table {
   public:
    const Large<T>& rows() const { return *rows_; }
    bool shares(const Table& other) const { return rows_ == other.rows_; }
    std::shared_ptr<const Large<T>> shared() const { return rows_; }

    // Rows may be written after one of these, which end the sharing.
    void assign(size_t n, const T& value) { own({}).assign(n, value); }
    template <class It>
    void assign(It first, It last) {
        own({}).assign(first, last);
    }
    void resize(size_t n) { own(*rows_).resize(n); }

    T* data() { return rows_->data(); }
    const T* data() const { return rows_->data(); }
    T& operator[](size_t i) { return (*rows_)[i]; }
    const T& operator[](size_t i) const { return (*rows_)[i]; }
    auto begin() { return rows_->begin(); }
    auto begin() const { return rows_->cbegin(); }
    auto end() const { return rows_->cend(); }
    size_t size() const { return rows_->size(); }
    bool empty() const { return rows_->empty(); }

   private:
    // first: what an own table begins as where this one is shared.
    Large<T>& own(const Large<T>& first) {
        if (rows_.use_count() > 1) rows_ = std::make_shared<Large<T>>(first);
        return *rows_;
    }

    std::shared_ptr<Large<T>> rows_ = std::make_shared<Large<T>>();
};

}  // namespace veriray
