// What the base does with a drive's map (paper §3.4): admit it, fit it to what is there, commit.
//
// Costs grow with the tiles around the segment, not with the base. One thread at a time.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/ingest/base_map.h"
#include "carmap/map/lean_map.h"
#include "carmap/map/map_diff.h"
#include "carmap/slam/georeference_map.h"
#include "carmap/update/apply_diff.h"
#include "carmap/update/fit.h"
#include "carmap/update/persistence.h"

namespace carmap {

struct ContributeOptions {
  FitOptions fit;
  ApplyOptions apply;
  GpsOptions gps;
  bool accept_suspect = false;  ///< also drives that called themselves suspect
  double radius_m = 60;         ///< tiles so near to the segment are looked at
  size_t max_word_tiles = 6;    ///< that are looked at where no fix tells
  int max_attempts = 3;         ///< to commit, when others commit to the same tiles
  PersistenceOptions persistence;
  /// Within that radius landmarks are recognised alike in one pass; the whole pass counts like so
  /// many landmarks more.
  double light_m = 8, light_prior = 10;
  /// A pass that saw so little of what it should have seen, and tells of so many landmarks, is not
  /// believed.
  double min_seen_share = 0.05;
  size_t min_doubted = 50;
};

/// What became of a segment.
struct Contribution {
  std::string name;
  std::vector<DriveId> drives;
  uint32_t component = 0;
  bool is_new_component = false;  ///< it touches nothing that was there, but for what it joins
  std::vector<uint32_t> joined;   ///< components that it connects to its own, which they became
  /// Components that look like the segment's road too, but where it does not fit, or which do not
  /// fit its own: they stay apart.
  std::vector<uint32_t> contradicting;
  std::optional<FitReport> fit;  ///< absent for a new component
  /// Between the segment's fixes and where it was fitted on the Earth, horizontally, the median.
  std::optional<double> gps_offset_m;
  size_t keyframes = 0;                           ///< of the segment
  size_t landmarks = 0;                           ///< of the segment
  size_t keyframes_added = 0;                     ///< the others stand where the base has one
  size_t landmarks_added = 0;                     ///< the others were there, or found no place
  size_t landmarks_replaced = 0;                  ///< of the base, that made way
  size_t seen = 0, missed = 0, seen_through = 0;  ///< landmarks of the base, by the drive
  bool is_doubted = false;  ///< it saw too little of them, so that what it missed does not count
  /// Tiles of which the drive saw something, but in a version that the base can no longer tell.
  size_t sightings_ignored = 0;
  size_t landmarks_confirmed = 0;  ///< that one drive alone had told of
  size_t landmarks_refuted = 0;    ///< the same, but no other drive saw them: they go
  size_t landmarks_returned = 0;   ///< of those added: they were there before, and had vanished
  size_t landmarks_vanished = 0;   ///< that are gone, by this drive and others before
  std::vector<TileVersion> tiles;  ///< that changed, and to which version
  uint64_t patch_bytes = 0;        ///< that vehicles will fetch for it
  uint64_t constraint_bytes = 0;   ///< of what it measured of poses, which stays at the base
  uint64_t sequence = 0;           ///< of its entry in the journal
};

/// Adds a segment to the base, all of it or nothing. Errors: InvalidArgument (not consistent, no
/// landmarks), AlreadyExists (its drive is there), FailedPrecondition (a suspect drive; the segment
/// contradicts the base, or fits in two places, with figures), Aborted (others keep committing to
/// the same tiles), those of the store.
absl::StatusOr<Contribution> Contribute(const LeanMap& segment, const std::string& name,
                                        BaseMap& base, const ContributeOptions& options = {});

/// Adds what a drive proposes that was localized in the base, so that nothing is searched for: a
/// diff in the frame of one of the base's tiles; or a segment that is a part of a drive, which is
/// fitted. What it saw and missed counts as a pass; landmarks that are gone by this and other
/// drives' passes go. Errors: as of Contribute; AlreadyExists for this part of the drive;
/// FailedPrecondition for a frame that the base does not have.
absl::StatusOr<Contribution> Contribute(const MapDiff& diff, const std::string& name, BaseMap& base,
                                        const ContributeOptions& options = {});

}  // namespace carmap
