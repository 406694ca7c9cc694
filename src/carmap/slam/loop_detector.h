// Whether the vehicle is where it was before (paper §5.4): proposes places that resemble a
// keyframe or lie near it, and believes in one only if its landmarks are seen from where they must
// be seen, keyframe after keyframe, and from nowhere else.
//
// A wrong loop ruins a map, a missed one is made up for by the next keyframe; so in doubt there is
// none. Owned by one thread. Deterministic.
#pragma once

#include <absl/container/btree_map.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "carmap/base/ids.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/word_histogram.h"
#include "carmap/index/word_index.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/map/map.h"
#include "carmap/slam/map_window.h"

namespace carmap {

class Vocabulary;

struct LoopDetectorOptions {
  // Which places are looked at.
  double min_driven_m = 40;               ///< between the place and the newest keyframe
  int tied_landmarks = 30;                ///< shared with a place that needs no loop any more
  float min_relative_similarity = 0.25f;  ///< to that with the keyframe before
  size_t max_places_by_words = 3;
  size_t max_places_by_position = 2;
  double position_radius_m = 15;  ///< by GPS, or else by the map; without fixes and words anywhere
  double max_turn_rad = 0.7;      ///< between the two views, by the map as it is

  // How far the map can have drifted: so much anyway, so much with each metre driven since the
  // place, and so much where the vehicle was lost in between.
  double drift_allowance_m = 5, drift_ratio = 0.04, drift_where_lost_m = 30;
  double drift_allowance_rad = 0.1, drift_rad_per_m = 2e-4;

  // What it takes for a keyframe to have been seen from there.
  TrackingOptions tracking;
  WindowOptions window{.keyframes = 8};  ///< keyframes around the place whose landmarks count
  double min_seen_share = 0.15;          ///< of the landmarks that must be in sight
  double max_sigma_m = 0.3, max_sigma_rad = 0.01;  ///< of the pose
  /// Another place that would explain the keyframe too, with so large a part of the inliers, makes
  /// both worthless: façades repeat.
  double max_rival_ratio = 0.4;

  // What it takes for keyframes to agree.
  size_t min_keyframes = 3;
  int min_chain_inliers = 80;       ///< of all of them together
  size_t max_missed_keyframes = 1;  ///< between two of them
  double min_chain_m = 3;           ///< driven from the first to the last
  double max_disagreement = 3;      ///< of two, in standard deviations
};

/// A keyframe as seen from an earlier place.
struct LoopMatch {
  KeyframeId keyframe_id, place_id;
  Rigid3 keyframe_from_place;  ///< between the two cameras
  Rigid3 map_from_keyframe;    ///< where the place's landmarks say that the keyframe is
  /// Of either pose, in the tangent of the keyframe.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  int inlier_count = 0;
  double seen_share = 0;
};

/// Keyframes one after the other that agree, the newest last.
using Loop = std::vector<LoopMatch>;

class LoopDetector {
 public:
  /// Without a vocabulary places are proposed by position alone.
  LoopDetector(const LoopDetectorOptions& options, std::shared_ptr<const Vocabulary> vocabulary);
  ~LoopDetector();

  /// Adds the newest keyframe, which is in the map, as are all before that were not culled.
  /// Returns a loop once enough keyframes agree on it; then begins anew.
  std::optional<Loop> Detect(const Map& map, const StereoRig& rig, KeyframeId newest);

  /// Keyframes whose place was not believed, though what it shows agrees: another place explains
  /// them too, or the map cannot have drifted so far.
  size_t rejected_count() const { return rejected_count_; }

 private:
  /// Sums along all keyframes that were added.
  struct Odometer {
    double driven_m = 0, drift_m = 0, drift_rad = 0;
  };

  void Add(const Map& map, const Keyframe& keyframe);
  Odometer Since(KeyframeId place_id) const;
  std::optional<KeyframeId> LastOfEarlierPass() const;
  bool IsPossible(const Keyframe& keyframe, const Keyframe& place) const;
  bool IsPossibleDrift(const Keyframe& keyframe, const LoopMatch& match) const;
  std::vector<KeyframeId> ProposePlaces(const Map& map, const Keyframe& keyframe,
                                        KeyframeId last_of_earlier_pass);
  std::vector<KeyframeId> RankByWords(const Map& map, const Keyframe& keyframe,
                                      const std::vector<KeyframeId>& excluded);
  std::vector<KeyframeId> RankByPosition(const Map& map, const Keyframe& keyframe) const;
  std::optional<LoopMatch> Match(const Map& map, const StereoRig& rig, const Keyframe& keyframe);
  bool Agrees(const Map& map, const LoopMatch& a, const LoopMatch& b) const;

  const LoopDetectorOptions options_;
  const std::shared_ptr<const Vocabulary> vocabulary_;
  std::optional<WordIndex> index_;
  WordHistogram histogram_, previous_histogram_;  ///< of the two newest keyframes
  absl::btree_map<KeyframeId, Odometer> odometer_;
  Loop chain_;
  size_t missed_ = 0;  ///< keyframes since the chain's last
  size_t rejected_count_ = 0;
};

/// The keyframe seen with the landmarks around a place that no keyframe after
/// `last_of_earlier_pass` sees; nothing unless all that LoopDetectorOptions asks of one keyframe
/// holds. Pure.
std::optional<LoopMatch> MatchPlace(const Map& map, const StereoRig& rig, const Keyframe& keyframe,
                                    KeyframeId place_id, KeyframeId last_of_earlier_pass,
                                    const LoopDetectorOptions& options);

}  // namespace carmap
