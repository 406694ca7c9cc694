// What the journal of a base tells: who changed what, when.
//
// Entries are JSON texts, for people too (`carmap base log`). Pure functions, thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/store/map_store.h"

namespace carmap {

struct Contribution;

/// What the keys of all contributions begin with.
inline constexpr std::string_view kContributionPrefix = "drive/";
/// Of a whole drive, and of a part of one, in the store's list of contributions.
/// `drive` in hexadecimal digits.
std::string KeyOf(std::string_view drive);
std::string KeyOf(DriveId drive);
std::string KeyOf(DriveId drive, uint32_t part);

/// An entry, as far as anybody needs it again.
struct LoggedChange {
  uint64_t sequence = 0;
  std::string kind;  ///< "add", "revert" or "adjust"
  std::string time;  ///< "2026-11-28T04:17:55Z"
  std::string name;  ///< what was added
  std::vector<std::string> drives;
  uint32_t component = 0;
  size_t keyframes_added = 0, landmarks_added = 0, landmarks_vanished = 0;
  std::vector<TileVersion> tiles;
};

std::string ToJournal(const Contribution& contribution);
std::string ToJournal(const LoggedChange& change);

/// Errors: DataLoss for an entry that is damaged, naming its number.
absl::StatusOr<LoggedChange> FromJournal(const JournalEntry& entry);

/// All entries, from the first. Errors: those of the store and of FromJournal.
absl::StatusOr<std::vector<LoggedChange>> ReadLog(const MapReader& reader);

/// Drives that were added and not taken back, in hexadecimal digits.
std::set<std::string> ContributedDrives(const std::vector<LoggedChange>& log);

/// Now, in UTC.
std::string TimeText();

}  // namespace carmap
