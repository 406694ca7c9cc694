// Reads a base map in RocksDB as it was at one moment. Thread-safe.
#pragma once

#include <rocksdb/options.h>
#include <rocksdb/snapshot.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "carmap/store/map_store.h"
#include "carmap/store/rocks_database.h"

namespace carmap {

class RocksReader final : public MapReader {
 public:
  /// Messages name the folder.
  RocksReader(std::shared_ptr<const RocksDatabase> database, std::filesystem::path folder);

  absl::StatusOr<std::string> Header() const override;
  absl::StatusOr<std::optional<StoredTile>> ReadTile(TileId tile) const override;
  absl::StatusOr<uint64_t> VersionOf(TileId tile) const override;
  absl::StatusOr<std::vector<TileVersion>> ListTiles() const override;
  absl::Status VisitWords(
      const std::function<void(TileId, std::string_view)>& visit) const override;
  absl::StatusOr<std::vector<StoredPatch>> ReadPatches(TileId tile,
                                                       uint64_t after_version) const override;
  absl::StatusOr<std::vector<std::pair<uint32_t, std::string>>> ReadComponents() const override;
  absl::StatusOr<std::optional<std::string>> ReadContribution(std::string_view key) const override;
  absl::Status VisitContributions(
      std::string_view prefix,
      const std::function<absl::Status(std::string_view, std::string_view)>& visit) const override;
  absl::StatusOr<std::vector<JournalEntry>> ReadJournal(uint64_t first_sequence,
                                                        size_t max_count) const override;

  absl::StatusOr<uint32_t> Format() const;
  /// Of the newest commit.
  absl::StatusOr<uint64_t> Sequence() const override;
  /// Version 0 if there never was such a tile.
  absl::StatusOr<TileVersion> FindTile(TileId tile) const;
  absl::StatusOr<bool> HasContribution(std::string_view key) const;

  /// Calls visit(key, value) for the keys from `begin` on, before `end`, until it is not ok.
  absl::Status Scan(
      Family family, const std::string& begin, const std::string& end, std::string_view what,
      const std::function<absl::Status(std::string_view, std::string_view)>& visit) const;

 private:
  absl::StatusOr<std::optional<std::string>> Find(Family family, std::string_view key,
                                                  std::string_view what) const;
  /// Of kMeta, where it must be.
  absl::StatusOr<std::string> Require(std::string_view key) const;
  /// A tile's bytes or words, which must be of the version.
  absl::StatusOr<std::string> ReadVersioned(Family family, const TileVersion& version) const;

  std::shared_ptr<const RocksDatabase> database_;
  std::filesystem::path folder_;
  rocksdb::ManagedSnapshot snapshot_;
  rocksdb::ReadOptions at_snapshot_;
};

}  // namespace carmap
