// Where in a map a frame was taken of which nothing is known (paper §3.2).
//
// The GPS fix scopes the search to the places around it, ranked by how much of the frame they
// resemble; when it proposes in vain, words look everywhere. Deterministic; work is bounded by
// counts of operations, so that a frame costs the same in a map of any size, and a frame that is
// looked for in vain leaves the places that it tried to the last turn of the frames after it.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "carmap/feature/feature_grid.h"
#include "carmap/feature/vocabulary.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/localize/map_neighbourhood.h"
#include "carmap/localize/place_index.h"
#include "carmap/localize/sized_features.h"

namespace carmap {

struct PlaceSearchOptions {
  TrackingOptions tracking{.min_inliers = 12};  ///< of a hypothesis
  NeighbourhoodOptions neighbourhood;
  PlaceOptions places;
  SizeMatchOptions matching;
  double gps_radius_m = 50;            ///< more than GPS errs between tall buildings
  size_t max_gps_places = 32;          ///< nearest first ...
  size_t max_gps_keyframes = 1024;     ///< ... of so many keyframes
  size_t max_tries = 5;                ///< places a frame
  size_t max_comparisons = 3'000'000;  ///< of signatures a frame; some more end the last try
  int max_samples = 2000;              ///< of three matches a place
  int min_agreeing_matches = 7;        ///< of a place, or it is none
  size_t max_hypotheses = 4;
  /// A pose with so many inliers ends the search, but for places that resemble the frame at least
  /// so much as the one where it was found: façades repeat.
  size_t sure_inliers = 50;
  float rival_similarity = 0.5f;  ///< to that of the found place
  size_t resting_searches = 10;   ///< after which a place tried in vain takes its turn again
};

/// A place where the frame may have been taken, and what speaks for it.
struct PlaceHypothesis {
  Rigid3 camera_from_map;
  std::vector<LandmarkMatch> inliers;
  uint32_t keyframe_idx = 0;  ///< in the middle of the place
  /// As PoseEstimate::covariance, of the inliers.
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  double seen_share = 0;     ///< inliers by landmarks that must be in sight from there
  bool is_near_fix = false;  ///< the map's keyframes there are near the frame's fix
};

class PlaceSearch {
 public:
  /// The map must have been reconstructed for the focal length of the frames. The vocabulary must
  /// not be null. The inverted index is built by the first search.
  PlaceSearch(const ReconstructedMap& map, std::shared_ptr<const Vocabulary> vocabulary,
              const PlaceSearchOptions& options = {});

  /// Distinct places where the frame may have been taken, most inliers first, weak ones with a
  /// dozen inliers included: whoever asks verifies them against each other and against the
  /// odometry.
  std::vector<PlaceHypothesis> Search(const FeatureGrid& grid, const StereoRig& rig,
                                      const std::optional<GpsFix>& gps);

  /// The next frame has nothing to do with those before it.
  void Forget() { last_vain_search_.clear(); }

 private:
  struct Candidate {
    uint32_t place_idx = 0;
    float similarity = 0;
    bool proposed_by_gps = false;
  };

  std::vector<Candidate> RankPlaces(const std::vector<Feature>& features,
                                    const std::optional<GpsFix>& gps) const;
  std::vector<Candidate> PlacesNear(const WordHistogram& histogram, const GpsFix& fix) const;
  size_t RestingSince(uint32_t place_idx) const;
  std::optional<PlaceHypothesis> Try(const Candidate& candidate, const SizedFeatures& features,
                                     const FeatureGrid& grid, const StereoRig& rig,
                                     size_t& comparisons) const;
  bool IsNearFix(const Rigid3& camera_from_map, const GpsFix& fix) const;
  std::optional<PlaceHypothesis> Judge(const TrackedPose& pose, const StereoRig& rig) const;
  bool IsWorthATry(const Candidate& candidate, const std::optional<Candidate>& found,
                   const std::vector<PlaceHypothesis>& hypotheses) const;

  const ReconstructedMap& map_;
  const std::shared_ptr<const Vocabulary> vocabulary_;
  const PlaceSearchOptions options_;
  std::optional<PlaceIndex> index_;
  size_t search_count_ = 0;
  std::vector<size_t> last_vain_search_;  ///< of each place, 0: none; empty: of no place
};

}  // namespace carmap
