#include "carmap/ingest/journal.h"

#include <absl/strings/numbers.h>
#include <absl/time/clock.h>
#include <absl/time/time.h>
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <utility>

#include "carmap/base/status_macros.h"
#include "carmap/ingest/contribute.h"

namespace carmap {
namespace {

absl::Status Damaged(uint64_t sequence) {
  return absl::DataLossError(fmt::format("entry {} of the journal is damaged", sequence));
}

nlohmann::ordered_json ToJson(const TileVersion& tile) {
  return {{"component", tile.tile.component},
          {"cell", fmt::format("{:016x}", tile.tile.cell)},
          {"version", tile.version},
          {"removed", tile.is_removed}};
}

}  // namespace

std::string KeyOf(std::string_view drive) {
  return fmt::format("{}{}", kContributionPrefix, drive);
}

std::string KeyOf(DriveId drive) { return KeyOf(ToHex(drive)); }

std::string KeyOf(DriveId drive, uint32_t part) { return fmt::format("{}/{}", KeyOf(drive), part); }

std::string TimeText() {
  return absl::FormatTime("%Y-%m-%dT%H:%M:%SZ", absl::Now(), absl::UTCTimeZone());
}

std::string ToJournal(const LoggedChange& change) {
  nlohmann::ordered_json json = {{"kind", change.kind},
                                 {"time", change.time},
                                 {"name", change.name},
                                 {"drives", change.drives},
                                 {"component", change.component},
                                 {"keyframes_added", change.keyframes_added},
                                 {"landmarks_added", change.landmarks_added},
                                 {"landmarks_vanished", change.landmarks_vanished}};
  json["tiles"] = nlohmann::ordered_json::array();
  for (const TileVersion& tile : change.tiles) json["tiles"].push_back(ToJson(tile));
  // Names of files may be in any encoding.
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

std::string ToJournal(const Contribution& contribution) {
  LoggedChange change{.kind = "add",
                      .time = TimeText(),
                      .name = contribution.name,
                      .component = contribution.component,
                      .keyframes_added = contribution.keyframes_added,
                      .landmarks_added = contribution.landmarks_added,
                      .landmarks_vanished = contribution.landmarks_vanished,
                      .tiles = contribution.tiles};
  for (const DriveId& drive : contribution.drives) change.drives.push_back(ToHex(drive));
  return ToJournal(change);
}

absl::StatusOr<LoggedChange> FromJournal(const JournalEntry& entry) {
  LoggedChange change{.sequence = entry.sequence};
  try {
    const auto json = nlohmann::json::parse(entry.text);
    change.kind = json.at("kind");
    change.time = json.at("time");
    change.name = json.at("name");
    change.drives = json.at("drives").get<std::vector<std::string>>();
    change.component = json.at("component");
    change.keyframes_added = json.at("keyframes_added");
    change.landmarks_added = json.at("landmarks_added");
    change.landmarks_vanished = json.value("landmarks_vanished", size_t{0});
    for (const auto& tile : json.at("tiles")) {
      TileVersion version;
      version.tile.component = tile.at("component");
      if (!absl::SimpleHexAtoi(tile.at("cell").get<std::string>(), &version.tile.cell)) {
        return Damaged(entry.sequence);
      }
      version.version = tile.at("version");
      version.is_removed = tile.at("removed");
      change.tiles.push_back(version);
    }
  } catch (const nlohmann::json::exception&) {
    return Damaged(entry.sequence);
  }
  return change;
}

absl::StatusOr<std::vector<LoggedChange>> ReadLog(const MapReader& reader) {
  constexpr size_t kAtOnce = 256;
  std::vector<LoggedChange> log;
  while (true) {
    CARMAP_ASSIGN_OR_RETURN(const std::vector<JournalEntry> entries,
                            reader.ReadJournal(log.size() + 1, kAtOnce));
    for (const JournalEntry& entry : entries) {
      CARMAP_ASSIGN_OR_RETURN(LoggedChange change, FromJournal(entry));
      log.push_back(std::move(change));
    }
    if (entries.size() < kAtOnce) return log;
  }
}

std::set<std::string> ContributedDrives(const std::vector<LoggedChange>& log) {
  std::set<std::string> drives;
  for (const LoggedChange& change : log) {
    for (const std::string& drive : change.drives) {
      if (change.kind == "add") drives.insert(drive);
      if (change.kind == "revert") drives.erase(drive);
    }
  }
  return drives;
}

}  // namespace carmap
