// Where a base map is kept: tiles, the journal of what changed them, who contributed, components.
//
// A store knows versions, names and order; what the values hold is for others to encode and check
// (carmap/format). One commit changes any number of tiles or none of them, and is durable when it
// returns. Readers take a snapshot and are never disturbed. Thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

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

#include "carmap/base/ids.h"

namespace carmap {

/// A tile that is there. Versions of a tile begin with 1 and never repeat, also where it went and
/// came back.
struct StoredTile {
  uint64_t version = 0;
  std::string bytes;
};

struct TileVersion {
  TileId tile;
  uint64_t version = 0;
  bool is_removed = false;  ///< the tile became empty in this version
};

/// What a tile became in one version, and what takes it back to the one before.
struct StoredPatch {
  uint64_t to_version = 0;  ///< from the one before
  std::string patch, inverse;
};

struct JournalEntry {
  uint64_t sequence = 0;  ///< from 1, without gaps
  std::string text;
};

/// A tile's next version.
struct TileChange {
  TileId tile;
  uint64_t from_version = 0;         ///< 0: there never was such a tile
  std::optional<std::string> bytes;  ///< absent: nothing is left of the tile
  std::string patch, inverse;
  std::string words;  ///< what places without GPS are found by; kept beside the tile
};

/// Of a contribution's key, in bytes.
inline constexpr size_t kMaxKeySize = 4096;

/// All or nothing.
struct Commit {
  std::vector<TileChange> tiles;                             ///< each tile once
  std::vector<std::pair<uint32_t, std::string>> components;  ///< put; empty: removed
  /// Put, each of which must not be there yet; empty values are allowed.
  std::vector<std::pair<std::string, std::string>> contributions;
  std::vector<std::string> withdrawn;  ///< contributions that are removed
  std::string journal_text;            ///< of the entry that tells of the commit
};

/// Reads what was committed up to some moment. Thread-safe. Errors: DataLoss for what is damaged,
/// naming the tile or the part of the store; Unavailable for what the disk denies.
class MapReader {
 public:
  virtual ~MapReader() = default;

  /// As it was given to the store when it was made.
  virtual absl::StatusOr<std::string> Header() const = 0;
  /// Nothing if there is no such tile, or it was removed.
  virtual absl::StatusOr<std::optional<StoredTile>> ReadTile(TileId tile) const = 0;
  /// 0 if there never was such a tile. Reads no tile.
  virtual absl::StatusOr<uint64_t> VersionOf(TileId tile) const = 0;
  /// All, removed ones too, ascending. Reads no tile.
  virtual absl::StatusOr<std::vector<TileVersion>> ListTiles() const = 0;
  /// Calls visit(tile, words) for each tile that is there, ascending; those that are damaged are
  /// left out, and the error names the first of them.
  virtual absl::Status VisitWords(
      const std::function<void(TileId, std::string_view)>& visit) const = 0;
  /// Ascending by version, all above `after_version`. Errors: besides, OutOfRange if the first of
  /// them was dropped (DropPatches).
  virtual absl::StatusOr<std::vector<StoredPatch>> ReadPatches(TileId tile,
                                                               uint64_t after_version) const = 0;
  virtual absl::StatusOr<std::vector<std::pair<uint32_t, std::string>>> ReadComponents() const = 0;
  virtual absl::StatusOr<std::optional<std::string>> ReadContribution(
      std::string_view key) const = 0;
  /// Calls visit(key, value) for each contribution whose key begins so, ascending, until it is not
  /// ok. `prefix` is not empty and does not end with '\xff'.
  virtual absl::Status VisitContributions(
      std::string_view prefix,
      const std::function<absl::Status(std::string_view key, std::string_view value)>& visit)
      const = 0;
  /// Of the journal's newest entry; 0 before the first.
  virtual absl::StatusOr<uint64_t> Sequence() const = 0;
  /// Entries from `first_sequence` on, ascending, at most `max_count`.
  virtual absl::StatusOr<std::vector<JournalEntry>> ReadJournal(uint64_t first_sequence,
                                                                size_t max_count) const = 0;
};

class MapStore : public MapReader {
 public:
  /// Returns the sequence of the journal's entry once everything is on disk. Errors: Aborted (a
  /// tile has another version than from_version, naming it: read it again), AlreadyExists (a
  /// contribution is there, naming its key), InvalidArgument (a tile, component or contribution
  /// twice, a tile removed that is not there, or a key longer than kMaxKeySize), ResourceExhausted
  /// (the disk is full), Unavailable, FailedPrecondition (opened to read only). After an error
  /// nothing has changed; after one of the disk's, Unavailable until snapshots are released.
  virtual absl::StatusOr<uint64_t> Apply(const Commit& commit) = 0;

  /// The store as it is now, whatever is committed after. It must not outlive the store.
  virtual std::unique_ptr<const MapReader> Snapshot() const = 0;

  /// Forgets the patches of all tiles that are older than the newest `kept` of each.
  virtual absl::Status DropPatches(size_t kept) = 0;
  /// Forgets all patches of one tile.
  virtual absl::Status DropPatchesOf(TileId tile) = 0;

  /// Whether all files are there and as they were written; reads them all. Errors: DataLoss.
  virtual absl::Status VerifyFiles() const = 0;
};

/// A store that ends with the process.
std::unique_ptr<MapStore> MakeMemoryStore(std::string header);

/// Makes the folder and an empty store in it. Errors: AlreadyExists (there is something), as
/// CheckWritable.
absl::StatusOr<std::unique_ptr<MapStore>> CreateRocksStore(const std::filesystem::path& folder,
                                                           std::string header);

enum class StoreAccess {
  kReadWrite,  ///< for one process at a time
  kReadOnly    ///< as it was when opened; beside one that writes, and others that read
};

/// Errors, each naming the folder, the cause and the remedy: NotFound (no folder, or no store in
/// it), Unavailable (another process writes it), DataLoss (its metadata are damaged), Unimplemented
/// (made by a newer version).
absl::StatusOr<std::unique_ptr<MapStore>> OpenRocksStore(const std::filesystem::path& folder,
                                                         StoreAccess access);

/// What a repair brought back, and what not.
struct StoreRepair {
  std::filesystem::path damaged;      ///< where the files lie now as they were
  uint64_t lost_journal_entries = 0;  ///< in whose places stands the text for lost ones
  uint64_t lost_commits = 0;          ///< the newest, of which nothing is left
};

/// Makes anew what a store that cannot be opened lost of its metadata, from all that can still be
/// read: which tables there are, versions of tiles, the sequence; `header` stands in for one that
/// is lost. What it does not know it does not invent: components and contributions in damaged
/// tables stay lost, and tiles whose bytes are lost are damaged. Errors: as OpenRocksStore;
/// Unavailable if another process writes it.
absl::StatusOr<StoreRepair> RepairRocksStore(const std::filesystem::path& folder,
                                             std::string_view header,
                                             std::string_view lost_journal_text);

}  // namespace carmap
