// A store whose reads are those of a snapshot taken for each: what one call returns belongs
// together. Thread-safe as the store's Snapshot().
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "carmap/store/map_store.h"

namespace carmap {

class SnapshotReads : public MapStore {
 public:
  absl::StatusOr<std::string> Header() const override { return Snapshot()->Header(); }
  absl::StatusOr<std::optional<StoredTile>> ReadTile(TileId tile) const override {
    return Snapshot()->ReadTile(tile);
  }
  absl::StatusOr<uint64_t> VersionOf(TileId tile) const override {
    return Snapshot()->VersionOf(tile);
  }
  absl::StatusOr<std::vector<TileVersion>> ListTiles() const override {
    return Snapshot()->ListTiles();
  }
  absl::Status VisitWords(
      const std::function<void(TileId, std::string_view)>& visit) const override {
    return Snapshot()->VisitWords(visit);
  }
  absl::StatusOr<std::vector<StoredPatch>> ReadPatches(TileId tile,
                                                       uint64_t after_version) const override {
    return Snapshot()->ReadPatches(tile, after_version);
  }
  absl::StatusOr<std::vector<std::pair<uint32_t, std::string>>> ReadComponents() const override {
    return Snapshot()->ReadComponents();
  }
  absl::StatusOr<std::optional<std::string>> ReadContribution(std::string_view key) const override {
    return Snapshot()->ReadContribution(key);
  }
  absl::Status VisitContributions(
      std::string_view prefix,
      const std::function<absl::Status(std::string_view, std::string_view)>& visit) const override {
    return Snapshot()->VisitContributions(prefix, visit);
  }
  absl::StatusOr<uint64_t> Sequence() const override { return Snapshot()->Sequence(); }
  absl::StatusOr<std::vector<JournalEntry>> ReadJournal(uint64_t first_sequence,
                                                        size_t max_count) const override {
    return Snapshot()->ReadJournal(first_sequence, max_count);
  }
};

}  // namespace carmap
