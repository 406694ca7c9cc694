// The working map of a drive: keyframes with all their features, and landmarks.
//
// Changed only through Apply (map_edit.h), by one thread. What other threads read is a MapSnapshot.
// Invariants, checked by CheckConsistency: both sides of every link agree; a landmark has at least
// one observation, at most one a keyframe; a feature belongs to at most one landmark.
#pragma once

#include <absl/container/btree_map.h>
#include <absl/status/status.h>

#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/map/map_types.h"

namespace carmap {

class Map {
 public:
  /// Grows by one with every edit.
  uint64_t version() const { return version_; }

  const absl::btree_map<KeyframeId, Keyframe>& keyframes() const { return keyframes_; }
  const absl::btree_map<LandmarkId, Landmark>& landmarks() const { return landmarks_; }

  /// The landmark that has taken over this one's observations, itself if none has.
  LandmarkId Heir(LandmarkId id) const;

  /// Null where there is none. The pointer lives until the next edit.
  const Keyframe* Find(KeyframeId id) const;
  const Landmark* Find(LandmarkId id) const;

  /// For each feature of the keyframe the landmark that it belongs to. The keyframe must exist.
  const std::vector<std::optional<LandmarkId>>& LandmarksOf(KeyframeId id) const;

 private:
  friend class EditApplication;

  uint64_t version_ = 0;
  absl::btree_map<KeyframeId, Keyframe> keyframes_;
  absl::btree_map<LandmarkId, Landmark> landmarks_;
  absl::btree_map<KeyframeId, std::vector<std::optional<LandmarkId>>> landmarks_of_;
  absl::btree_map<LandmarkId, LandmarkId> merged_into_;  ///< of those merged into another
};

/// Errors: Internal, naming the first record that breaks an invariant.
absl::Status CheckConsistency(const Map& map);

}  // namespace carmap
