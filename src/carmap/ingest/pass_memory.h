// What a pass of a drive adds to the evidence of tiles, and what follows from all passes: landmarks
// that are confirmed, and those that are gone.
//
// Not thread-safe.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/ingest/base_map.h"
#include "carmap/ingest/changes.h"
#include "carmap/ingest/evidence.h"
#include "carmap/map/map_diff.h"
#include "carmap/store/map_store.h"
#include "carmap/update/persistence.h"

namespace carmap {

/// Ids of the tile's landmarks in this version, ascending; nothing if the base does not know it any
/// more. Errors: those of the store.
absl::StatusOr<std::optional<std::vector<LandmarkId>>> LandmarksOfVersion(TileId tile,
                                                                          uint64_t version,
                                                                          const BaseMap& base);

/// How alike landmarks near each other are recognised in one pass.
struct PassLight {
  double radius_m = 8;
  double prior = 10;  ///< landmarks, as which the whole pass counts
};

struct PassConsequences {
  size_t confirmed = 0, refuted = 0, vanished = 0, returned = 0;  ///< landmarks
};

class PassMemory {
 public:
  /// Both must outlive it.
  PassMemory(const Changes& changes, const BaseMap& base, const PersistenceOptions& options)
      : changes_(changes), base_(base), options_(options) {}

  /// Tiles as they are in the changes, with the evidence of the store. Errors: those of reading.
  absl::Status Load(const std::vector<TileId>& tiles);

  /// A drive's pass: what it saw and missed of landmarks; those of other tiles do not count.
  void AddPass(DriveId drive, int64_t time_s, const std::map<LandmarkId, Sighting>& outcomes,
               const PassLight& light);

  /// These are new, by one drive alone: to be confirmed by the first other one that sees them. What
  /// was there before, and has come back, is known again at once.
  void AddNews(const std::set<LandmarkId>& news);

  /// Landmarks that were to be confirmed and are count another drive; those that several drives
  /// should have confirmed but did not go, and so do those that are gone.
  /// Errors: as Changes::Put.
  absl::StatusOr<PassConsequences> Draw(Changes& changes);

  /// What is to be remembered.
  void AddTo(Commit& commit) const;

 private:
  struct Remembered {
    std::shared_ptr<const Tile> tile;  ///< null if nothing is left of it
    StoredEvidence stored;
    std::map<LandmarkId, uint8_t> returned;  ///< news, and how many drives knew them before
  };
  const Changes& changes_;
  const BaseMap& base_;
  const PersistenceOptions options_;
  std::map<TileId, Remembered> tiles_;
};

}  // namespace carmap
