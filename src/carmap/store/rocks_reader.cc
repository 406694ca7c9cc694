#include "carmap/store/rocks_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "carmap/base/status_macros.h"
#include "carmap/store/commit_check.h"
#include "carmap/store/rocks_keys.h"

namespace carmap {
namespace {

constexpr std::string_view kMetadata = "the store's metadata";

std::string_view View(const rocksdb::Slice& slice) { return {slice.data(), slice.size()}; }

/// Ends the keys that begin with the prefix.
std::string After(char prefix) { return std::string(1, static_cast<char>(prefix + 1)); }

}  // namespace

RocksReader::RocksReader(std::shared_ptr<const RocksDatabase> database,
                         std::filesystem::path folder)
    : database_(std::move(database)), folder_(std::move(folder)), snapshot_(&database_->db()) {
  at_snapshot_.snapshot = snapshot_.snapshot();
  at_snapshot_.verify_checksums = true;
}

absl::StatusOr<std::string> RocksReader::Header() const { return Require(kHeaderKey); }

absl::StatusOr<std::optional<StoredTile>> RocksReader::ReadTile(TileId tile) const {
  CARMAP_ASSIGN_OR_RETURN(const TileVersion version, FindTile(tile));
  if (version.version == 0 || version.is_removed) return std::nullopt;
  CARMAP_ASSIGN_OR_RETURN(std::string bytes, ReadVersioned(Family::kTiles, version));
  return StoredTile{version.version, std::move(bytes)};
}

absl::StatusOr<uint64_t> RocksReader::VersionOf(TileId tile) const {
  CARMAP_ASSIGN_OR_RETURN(const TileVersion version, FindTile(tile));
  return version.version;
}

absl::StatusOr<std::vector<TileVersion>> RocksReader::ListTiles() const {
  std::vector<TileVersion> tiles;
  CARMAP_RETURN_IF_ERROR(Scan(Family::kMeta, std::string(1, kVersionPrefix), After(kVersionPrefix),
                              kMetadata,
                              [&](std::string_view key, std::string_view value) -> absl::Status {
                                const auto version = DecodeVersion(TileOfVersionKey(key), value);
                                if (key.size() != kVersionKeySize || !version) {
                                  return Damaged(folder_, kMetadata, "a version of a tile");
                                }
                                tiles.push_back(*version);
                                return absl::OkStatus();
                              }));
  return tiles;
}

absl::Status RocksReader::VisitWords(
    const std::function<void(TileId, std::string_view)>& visit) const {
  CARMAP_ASSIGN_OR_RETURN(const std::vector<TileVersion> tiles, ListTiles());
  absl::Status first_error;
  for (const TileVersion& tile : tiles) {
    if (tile.is_removed) continue;
    // One by one, since a scan would end at the first damage.
    const auto words = ReadVersioned(Family::kWords, tile);
    if (words.ok()) {
      visit(tile.tile, *words);
    } else {
      first_error.Update(words.status());
    }
  }
  return first_error;
}

absl::StatusOr<std::vector<StoredPatch>> RocksReader::ReadPatches(TileId tile,
                                                                  uint64_t after_version) const {
  CARMAP_ASSIGN_OR_RETURN(const TileVersion newest, FindTile(tile));
  std::vector<StoredPatch> patches;
  if (after_version >= newest.version) return patches;
  const std::string what = fmt::format("a patch of {}", NameOf(tile));
  CARMAP_RETURN_IF_ERROR(
      Scan(Family::kPatches, PatchKey(tile, after_version + 1), PatchKey(tile, newest.version + 1),
           what, [&](std::string_view key, std::string_view value) -> absl::Status {
             const uint64_t version = ReadBigEndian<uint64_t>(key.substr(TileKey(tile).size()));
             if (patches.empty() && version != after_version + 1) {
               return PatchesDropped(folder_.string(), tile, after_version);
             }
             const auto patch = DecodePatch(version, value);
             if (!patch || version != after_version + 1 + patches.size()) {
               return Damaged(folder_, what, "not as it was written");
             }
             patches.push_back(*patch);
             return absl::OkStatus();
           }));
  if (patches.empty()) return PatchesDropped(folder_.string(), tile, after_version);
  if (patches.back().to_version != newest.version) return Damaged(folder_, what, "missing");
  return patches;
}

absl::StatusOr<std::vector<std::pair<uint32_t, std::string>>> RocksReader::ReadComponents() const {
  std::vector<std::pair<uint32_t, std::string>> components;
  CARMAP_RETURN_IF_ERROR(
      Scan(Family::kMeta, std::string(1, kComponentPrefix), After(kComponentPrefix), kMetadata,
           [&](std::string_view key, std::string_view value) {
             components.emplace_back(ReadBigEndian<uint32_t>(key.substr(1)), std::string(value));
             return absl::OkStatus();
           }));
  return components;
}

absl::StatusOr<std::optional<std::string>> RocksReader::ReadContribution(
    std::string_view key) const {
  return Find(Family::kContributions, key, fmt::format("contribution {}", key));
}

absl::Status RocksReader::VisitContributions(
    std::string_view prefix,
    const std::function<absl::Status(std::string_view, std::string_view)>& visit) const {
  std::string end(prefix);
  ++end.back();
  return Scan(Family::kContributions, std::string(prefix), end, "the contributions", visit);
}

absl::StatusOr<std::vector<JournalEntry>> RocksReader::ReadJournal(uint64_t first_sequence,
                                                                   size_t max_count) const {
  CARMAP_ASSIGN_OR_RETURN(const uint64_t newest, Sequence());
  const uint64_t first = std::max<uint64_t>(first_sequence, 1);
  std::vector<JournalEntry> entries;
  if (first > newest) return entries;
  const uint64_t count = std::min<uint64_t>(max_count, newest - first + 1);
  CARMAP_RETURN_IF_ERROR(
      Scan(Family::kJournal, SequenceKey(first), SequenceKey(first + count), "the journal",
           [&](std::string_view key, std::string_view value) -> absl::Status {
             entries.push_back({ReadBigEndian<uint64_t>(key), std::string(value)});
             return absl::OkStatus();
           }));
  for (uint64_t i = 0; i < count; ++i) {
    if (i >= entries.size() || entries[i].sequence != first + i) {
      return Damaged(folder_, "the journal", fmt::format("entry {} is missing", first + i));
    }
  }
  return entries;
}

absl::StatusOr<uint32_t> RocksReader::Format() const {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, Require(kFormatKey));
  return ReadBigEndian<uint32_t>(bytes);
}

absl::StatusOr<uint64_t> RocksReader::Sequence() const {
  CARMAP_ASSIGN_OR_RETURN(const std::string bytes, Require(kSequenceKey));
  return ReadBigEndian<uint64_t>(bytes);
}

absl::StatusOr<TileVersion> RocksReader::FindTile(TileId tile) const {
  CARMAP_ASSIGN_OR_RETURN(const auto bytes, Find(Family::kMeta, VersionKey(tile), kMetadata));
  if (!bytes) return TileVersion{tile};
  const auto version = DecodeVersion(tile, *bytes);
  if (!version) return Damaged(folder_, kMetadata, "a version of a tile");
  return *version;
}

absl::StatusOr<bool> RocksReader::HasContribution(std::string_view key) const {
  CARMAP_ASSIGN_OR_RETURN(const auto value, ReadContribution(key));
  return value.has_value();
}

absl::Status RocksReader::Scan(
    Family family, const std::string& begin, const std::string& end, std::string_view what,
    const std::function<absl::Status(std::string_view, std::string_view)>& visit) const {
  const rocksdb::Slice upper_bound(end);
  rocksdb::ReadOptions options = at_snapshot_;
  options.iterate_upper_bound = &upper_bound;
  const std::unique_ptr<rocksdb::Iterator> iterator(
      database_->db().NewIterator(options, database_->family(family)));
  for (iterator->Seek(begin); iterator->Valid(); iterator->Next()) {
    CARMAP_RETURN_IF_ERROR(visit(View(iterator->key()), View(iterator->value())));
  }
  return Translate(iterator->status(), folder_, what);
}

absl::StatusOr<std::optional<std::string>> RocksReader::Find(Family family, std::string_view key,
                                                             std::string_view what) const {
  std::string value;
  const rocksdb::Status status = database_->db().Get(
      at_snapshot_, database_->family(family), rocksdb::Slice(key.data(), key.size()), &value);
  if (status.IsNotFound()) return std::nullopt;
  CARMAP_RETURN_IF_ERROR(Translate(status, folder_, what));
  return value;
}

absl::StatusOr<std::string> RocksReader::Require(std::string_view key) const {
  CARMAP_ASSIGN_OR_RETURN(auto value, Find(Family::kMeta, key, kMetadata));
  if (!value) return Damaged(folder_, kMetadata, fmt::format("no entry {}", key));
  return *std::move(value);
}

absl::StatusOr<std::string> RocksReader::ReadVersioned(Family family,
                                                       const TileVersion& version) const {
  const std::string name = NameOf(version.tile);
  CARMAP_ASSIGN_OR_RETURN(auto value, Find(family, TileKey(version.tile), name));
  if (!value) return Damaged(folder_, name, "missing");
  ByteReader reader(*value);
  if (reader.Uint<uint64_t>() != version.version || !reader.ok()) {
    return Damaged(folder_, name, "of another version");
  }
  return value->substr(sizeof(uint64_t));
}

}  // namespace carmap
