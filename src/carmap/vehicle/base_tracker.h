// A vehicle's pose in the base map, frame by frame (paper §3.2): its own odometry predicts the
// pose, the base landmarks that it sees correct it.
//
// A frame in which no base landmark is seen still has a pose, with a covariance that says how far
// dead reckoning has come. A vehicle that does not know where it is looks for places and believes
// in one that frame after frame agrees with its own motion. Owned by one thread; the map is shared.
// Deterministic.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "carmap/base/time.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/frame_tracking.h"
#include "carmap/localize/map_neighbourhood.h"
#include "carmap/localize/place_search.h"
#include "carmap/slam/frame_extraction.h"
#include "carmap/slam/tracker.h"
#include "carmap/vehicle/window_estimator.h"

namespace carmap {

enum class KnownBy { kLost, kDeadReckoning, kMap };

struct VehiclePose {
  KnownBy known_by = KnownBy::kLost;
  std::optional<UncertainPose> pose;   ///< absent if lost
  double dead_reckoned_m = 0;          ///< driven since the last frame known by the map
  std::vector<LandmarkMatch> inliers;  ///< landmarks of the base that agree with the pose
};

struct BaseTrackerOptions {
  WindowEstimatorOptions window;
  NeighbourhoodOptions neighbourhood;
  PlaceSearchOptions search;

  // Seeing the base from where the vehicle must be.
  double search_sigmas = 3;          ///< of the prediction, that a landmark is looked for within
  double common_disparity_px = 0.4;  ///< by which the map's depths may be off all alike
  double min_radius_px = 4;          ///< besides that
  size_t min_inliers = 10;           ///< fewer may agree by chance
  double min_inlier_share = 0.25;    ///< of the matches
  double max_square_deviation = 60;  ///< from the prediction, in its covariance (6 dof)

  // The vehicle's own motion, which traffic around it can drag along.
  size_t steady_motions = 5;     ///< in a row, after which another must be possible to be believed
  double unsteady_step_m = 0.5;  ///< error of a motion before that: it may be that of traffic
  double max_acceleration_m_s2 = 12;
  double speed_tolerance_m_s = 0.5, speed_tolerance_ratio = 0.1;  ///< stamps of time are not exact

  // Finding the place.
  size_t clear_inliers = 30;        ///< of a clear sight of the base
  double search_after_m = 10;       ///< without one: then other places are looked for too ...
  double search_sigma_m = 0.5;      ///< ... or where the pose is less certain than that
  double min_gain = 1.5;            ///< in inliers, of another place over the present one
  double same_place_m = 1;          ///< nearer two hypotheses are one
  size_t sure_place_inliers = 50;   ///< in one frame: that is a place
  size_t total_place_inliers = 60;  ///< over frames ...
  size_t min_place_frames = 3;      ///< ... at least so many
  double max_rival_share = 0.5;     ///< of the inliers of any other place
  size_t max_hypotheses = 6;        ///< that are followed

  // Losing it.
  double max_sigma_m = 5;            ///< of a pose; beyond, the vehicle is lost
  double unseen_motion_ratio = 0.3;  ///< error of a motion that nothing but the last one tells
};

class BaseTracker {
 public:
  /// The map must have been reconstructed for the rig's focal length. The rig's disparity bias is
  /// that of the frames (TrackedFrame), which learn it on the way: a rig of the same calibration
  /// that mapped may have another. The vocabulary, by whose words places are looked for, must not
  /// be null.
  BaseTracker(std::shared_ptr<const ReconstructedMap> base, const StereoRig& rig,
              std::shared_ptr<const Vocabulary> vocabulary, const BaseTrackerOptions& options = {});

  /// From the next frame on the base is this one, in the same frame: other tiles of it, or newer
  /// ones. The pose stays, so that no frame is lost.
  void Swap(std::shared_ptr<const ReconstructedMap> base);

  const std::shared_ptr<const ReconstructedMap>& base() const { return base_; }

  /// Frames in the order of time; `own` is what the drive's own map made of it.
  VehiclePose Take(const ExtractedFrame& frame, const TrackedFrame& own);

 private:
  /// A motion since the last frame that was tracked.
  struct Step {
    Rigid3 motion;
    Matrix6d covariance = Matrix6d::Zero();
  };
  /// Where the vehicle may be.
  struct Hypothesis {
    UncertainPose pose;
    std::vector<LandmarkMatch> inliers;  ///< in the newest frame
    size_t total_inliers = 0, frames = 0;
    bool is_seen = true;  ///< in the newest frame
  };
  struct Observation {
    SeenLandmarks landmarks;
    std::vector<LandmarkMatch> inliers;
  };

  std::optional<Step> StepOf(const ExtractedFrame& frame, const TrackedFrame& own);
  std::optional<Observation> Observe(const FeatureGrid& grid, const UncertainPose& predicted);
  PoseEstimate MatchAndRefine(const FeatureGrid& grid, const UncertainPose& predicted,
                              const Rigid3& camera_from_base, double position_radius_m,
                              double radius_px, Observation& observation);
  SeenLandmarks See(const FeatureGrid& grid, const Rigid3& camera_from_base,
                    const std::vector<LandmarkMatch>& matches) const;
  const std::vector<uint32_t>& LandmarksNear(const Rigid3& base_from_camera);

  bool IsPossible(const Rigid3& motion, double interval_s, double elapsed_s) const;

  bool IsFollowed(const std::vector<Hypothesis>& hypotheses, const UncertainPose& pose) const;
  void FollowHypotheses(const FeatureGrid& grid, const Step& step);
  void SearchPlaces(const FeatureGrid& grid, const std::optional<GpsFix>& gps);
  const Hypothesis* BelievedHypothesis() const;
  void Believe(const Hypothesis& hypothesis, Observation& seen);
  VehiclePose Report(const Step& step, Observation seen);

  std::shared_ptr<const ReconstructedMap> base_;
  StereoRig rig_;  ///< with the bias of the newest frame
  const std::shared_ptr<const Vocabulary> vocabulary_;
  const BaseTrackerOptions options_;
  std::optional<PlaceSearch> search_;  ///< in the base; never empty
  std::optional<WindowEstimator> window_;
  std::vector<Hypothesis> hypotheses_;
  double dead_reckoned_m_ = 0;
  double unclear_m_ = 0;  ///< driven since the last clear sight of the base

  std::optional<Timestamp> last_time_;  ///< of the last frame that was tracked
  Rigid3 last_motion_;                  ///< the last that was believed
  double last_motion_s_ = 0;            ///< that it took; 0 if there was none
  size_t steady_motions_ = 0;           ///< in a row
  double motion_known_at_s_ = 0;  ///< then it was believed, or the base showed that it went on

  Rigid3 neighbourhood_center_;
  std::vector<uint32_t> neighbourhood_;  ///< landmarks around it
};

}  // namespace carmap
