// Many short lists in one block of memory, one list for each of a dense range of owners.
//
// A plain value, immutable by convention once filled.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace carmap {

template <typename T>
class Grouped {
 public:
  /// Number of lists.
  size_t size() const { return begin_.size() - 1; }
  std::span<const T> operator[](size_t owner) const {
    return std::span(values_).subspan(begin_[owner], begin_[owner + 1] - begin_[owner]);
  }

  /// Values go to the list that the next EndList completes.
  void Append(const T& value) { values_.push_back(value); }
  void EndList() { begin_.push_back(values_.size()); }
  void ReserveValues(size_t count) { values_.reserve(count); }

 private:
  std::vector<size_t> begin_{0};
  std::vector<T> values_;
};

}  // namespace carmap
