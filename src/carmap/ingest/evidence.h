// What passes said of a tile's landmarks: by this the base forgets (paper §3.4 leaves it open).
//
// Kept in the store, a value a tile, and never sent. Passes are keyed by drive, in any order; a
// drive counts once, however many diffs it sent. The newest kMaxPasses of a tile are kept. Plain
// values; functions are pure and thread-safe.
#pragma once

#include <absl/status/statusor.h>

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/feature/feature.h"
#include "carmap/map/map_diff.h"
#include "carmap/store/map_store.h"
#include "carmap/update/persistence.h"

namespace carmap {

/// A landmark that is gone, as its tile had it.
struct VanishedLandmark {
  LandmarkId id;
  Eigen::Vector3f position_in_tile = Eigen::Vector3f::Zero();
  Descriptor descriptor;
  uint8_t drive_count = 1;
  float log_odds = 0;  ///< that it was gone
  int64_t time_s = 0;  ///< Unix time of the newest pass then
  bool operator==(const VanishedLandmark&) const = default;
};

class TileEvidence {
 public:
  static constexpr size_t kMaxPasses = 64, kMaxVanished = 4096;

  /// The drive passed, at this Unix time: of several, the first that was told.
  void AddPass(DriveId drive, int64_t time_s);
  /// What the drive, whose pass is there, saw of the landmark: the best of all that it sent. Log
  /// odds as PassSighting has them.
  void Record(LandmarkId landmark, DriveId drive, Sighting outcome, double log_odds);
  /// As if it had never passed.
  void RemovePass(DriveId drive);
  /// Nobody asks for it any more.
  void RemoveLandmark(LandmarkId landmark);

  /// One drive alone told of the landmark so far.
  void AwaitConfirmation(LandmarkId landmark) { awaiting_.insert(landmark); }
  /// Those that another drive than their own saw by now, ascending; they await nothing any more.
  std::vector<LandmarkId> TakeConfirmed();
  /// Those that would hardly have been missed by all drives that should have seen them, were they
  /// there; they are forgotten.
  std::vector<LandmarkId> TakeRefuted();
  bool IsAwaited(LandmarkId landmark) const { return awaiting_.contains(landmark); }

  /// Of the landmark, in the order of time; passes before its own drive's do not count.
  std::vector<PassSighting> PassesOf(LandmarkId landmark) const;

  /// It is gone: its passes are forgotten, itself is remembered. Of many, the last.
  void AddVanished(const VanishedLandmark& landmark);
  const std::vector<VanishedLandmark>& vanished() const { return vanished_; }
  /// What is gone from there and looked so, if anything: it has come back.
  std::optional<VanishedLandmark> TakeReturned(const Eigen::Vector3d& position_in_tile,
                                               const Descriptor& descriptor);

  /// Unix time of the drive's pass, if it is remembered.
  std::optional<int64_t> TimeOf(DriveId drive) const;

  /// How many passes saw, missed and saw through it.
  struct Counts {
    size_t seen = 0, missed = 0, seen_through = 0;
  };
  Counts CountsOf(LandmarkId landmark) const;
  size_t pass_count() const { return times_.size(); }
  std::vector<DriveId> Drives() const;
  /// Unix time of the oldest and the newest pass; 0 without any.
  int64_t OldestPassS() const;
  int64_t NewestPassS() const;
  bool operator==(const TileEvidence&) const = default;

  std::string Encode() const;
  /// Errors: DataLoss.
  static absl::StatusOr<TileEvidence> Decode(std::string_view bytes);

 private:
  /// Outcome and log odds, quantised as they are stored.
  struct Observation {
    Sighting outcome = Sighting::kNone;
    int8_t odds_steps = 0;
    bool operator==(const Observation&) const = default;
  };
  void DropOldest();
  /// Whether another drive than its own saw it.
  bool IsConfirmed(LandmarkId landmark) const;
  /// How unlikely it is, if it is there, that the other drives did not see it.
  double LogOddsOfMisses(LandmarkId landmark) const;

  std::map<DriveId, int64_t> times_;
  std::map<LandmarkId, std::map<DriveId, Observation>> observations_;
  std::set<LandmarkId> awaiting_;
  std::vector<VanishedLandmark> vanished_;  ///< in the order in which they went
};

/// The tile's evidence, and the number of its present state: 0 if there is none.
struct StoredEvidence {
  TileEvidence evidence;
  uint64_t revision = 0;
};
/// Errors: those of the store; DataLoss naming the tile.
absl::StatusOr<StoredEvidence> ReadEvidence(const MapReader& reader, TileId tile);

/// Lets the commit replace what was read, unless another commit did so meanwhile (AlreadyExists).
void ReplaceEvidence(TileId tile, uint64_t read_revision, const TileEvidence& evidence,
                     Commit& commit);
/// Lets the commit remove it with its tile.
void RemoveEvidence(TileId tile, uint64_t read_revision, Commit& commit);

/// Lets the commit remove it, whatever is in it. Errors: those of the store.
absl::Status DropEvidence(const MapReader& reader, TileId tile, Commit& commit);

/// Calls visit(tile) for each tile that has evidence. Reads all evidence of the base. Errors: those
/// of the store.
absl::Status VisitEvidence(const MapReader& reader, const std::function<void(TileId)>& visit);

}  // namespace carmap
