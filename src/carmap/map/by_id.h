// Records in the order of their ids, as maps have them: drives, keyframes, landmarks.
//
// Pure, thread-safe.
#pragma once

#include <algorithm>
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

}  // namespace carmap
