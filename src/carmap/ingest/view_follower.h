// The tiles around a vehicle (paper §3.2, §3.5): which part of the base it localizes in as it
// drives.
//
// On the Earth, tiles are found by the vehicle's fix, elsewhere by the words of what it sees; once
// it knows where it is, by its pose. Only these are read. Owned by one thread; the base must
// outlive it.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/map_view.h"
#include "carmap/index/reconstruct.h"
#include "carmap/ingest/base_map.h"
#include "carmap/ingest/candidate_tiles.h"
#include "carmap/ingest/patched_tiles.h"
#include "carmap/map/tile.h"

namespace carmap {

struct FollowerOptions {
  double needed_m = 100;           ///< tiles nearer than that must be there ...
  double loaded_m = 250;           ///< ... and when some are not, these are read
  size_t max_word_tiles = 4;       ///< that are looked at where no fix tells
  size_t frames_of_component = 4;  ///< in which a vehicle is looked for in one, if others are near
};

class ViewFollower {
 public:
  /// `vocabulary` must not be null.
  ViewFollower(const BaseMap& base, double focal_length_px,
               std::shared_ptr<const Vocabulary> vocabulary, const FollowerOptions& options = {});

  enum class Change { kNone, kTiles, kComponent };

  /// What became of tiles since the base was opened; shows from the next frame on.
  void Take(Patch patch);

  /// Before each frame: where the vehicle is in the view, if it knows, its fix and what it sees.
  /// After kTiles the map is another one in the same frame; after kComponent poses before mean
  /// nothing. Errors: those of the store that are not about a tile.
  absl::StatusOr<Change> Follow(const std::optional<Rigid3>& view_from_camera,
                                const std::optional<GpsFix>& gps,
                                const std::vector<Feature>& features);

  /// Empty until tiles were found.
  const MapView& view() const { return *view_; }
  const std::shared_ptr<const ReconstructedMap>& map() const { return map_; }

  /// All tiles of the present component that were read, in the frame of the view.
  absl::StatusOr<MapView> Used() const;
  /// Tiles that cannot be read, each with the reason; the vehicle does without them.
  const std::vector<std::string>& damaged() const { return damaged_; }
  uint64_t tiles_read() const { return used_.size(); }
  /// Patches that were applied, and those that could not be, a line each.
  size_t patches_applied() const { return tiles_.applied(); }
  const std::vector<std::string>& patch_faults() const { return tiles_.faults(); }

 private:
  absl::StatusOr<std::vector<CandidateTiles>> Candidates(
      const std::optional<GpsFix>& gps, const std::vector<Feature>& features) const;
  absl::StatusOr<Change> FollowPose(const Rigid3& view_from_camera);
  absl::StatusOr<Change> LookAround(const std::optional<GpsFix>& gps,
                                    const std::vector<Feature>& features);
  /// Of these none is to be read again.
  bool HasAll(const std::vector<TileId>& tiles) const;
  absl::Status Load(const Component& component, uint64_t frame_cell,
                    const std::vector<TileId>& tiles);

  const BaseMap& base_;
  PatchedTiles tiles_;
  const double focal_length_px_;
  const std::shared_ptr<const Vocabulary> vocabulary_;
  const FollowerOptions options_;
  std::optional<Component> component_;
  std::optional<MapView> view_;  ///< never empty
  std::shared_ptr<const ReconstructedMap> map_;
  std::set<TileId> loaded_, used_, unreadable_;
  bool is_stale_ = false;  ///< patches came of tiles that are loaded
  std::vector<std::string> damaged_;
  size_t lost_frames_ = 0;  ///< in this component, since it was chosen
  size_t next_candidate_ = 0;
};

}  // namespace carmap
