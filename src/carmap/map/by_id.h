// Records in the order of their ids, as maps have them: drives, keyframes, landmarks.
//
// Pure, thread-safe.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

namespace carmap {

inline constexpr auto kById = [](const auto& a, const auto& b) { return a.id < b.id; };

/// The record with this id, of records ascending by id; null if there is none.
template <typename Record>
const Record* FindById(const std::vector<Record>& records, const decltype(Record::id)& id) {
  const auto found = std::lower_bound(
      records.begin(), records.end(), id,
      [](const Record& record, const decltype(Record::id)& wanted) { return record.id < wanted; });
  return found != records.end() && found->id == id ? &*found : nullptr;
}

template <typename Record>
Record* FindById(std::vector<Record>& records, const decltype(Record::id)& id) {
  return const_cast<Record*>(FindById(std::as_const(records), id));
}

/// Finds records by ids that ascend from one call to the next, of records ascending by id.
template <typename Record>
class AscendingSearch {
 public:
  explicit AscendingSearch(const std::vector<Record>& records)
      : next_(records.begin()), end_(records.end()) {}

  const Record* Find(const decltype(Record::id)& id) {
    while (next_ != end_ && next_->id < id) ++next_;
    return next_ != end_ && next_->id == id ? &*next_ : nullptr;
  }

 private:
  typename std::vector<Record>::const_iterator next_, end_;
};

}  // namespace carmap
