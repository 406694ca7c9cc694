// The vehicle's pose in a given map, frame by frame (paper §3.2, §3.5).
//
// Tracks from frame to frame in the map and finds its place again when it was lost. Owned by one
// thread; the map is shared and must outlive it.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "carmap/base/time.h"
#include "carmap/feature/feature.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/geodesy.h"
#include "carmap/geometry/rigid3.h"
#include "carmap/index/reconstruct.h"
#include "carmap/localize/relocalization.h"

namespace carmap {

struct LocalizerOptions {
  RelocalizationOptions relocalization;  ///< its tracking and neighbourhood hold for tracking too
  double wide_factor = 4;                ///< on the search window when the first one finds nothing
  double max_prediction_s = 2;           ///< an older pose predicts nothing
  double trust_s = 1;  ///< so long a pose that won against all others vouches for those after it
};

enum class FoundBy { kNothing, kTracking, kWideTracking, kRelocalization };

struct LocalizedFrame {
  std::optional<Rigid3> map_from_camera;  ///< absent if the frame is lost
  std::vector<LandmarkMatch> inliers;     ///< landmarks of the map that agree with the pose
  FoundBy found_by = FoundBy::kNothing;
  double tracking_ms = 0, relocalization_ms = 0;
};

class Localizer {
 public:
  /// The map must have been reconstructed for the rig's focal length.
  Localizer(const ReconstructedMap& map, const StereoRig& rig, const LocalizerOptions& options = {})
      : map_(map), rig_(rig), options_(options) {}

  /// A tracked pose is taken at once if the vehicle's speed was known, it has half the inliers of
  /// the one before, and it is sure (RelocalizationOptions) or a pose of a moment ago was: by
  /// itself, or because it won. Otherwise a wider search and relocalization compete with it.
  /// `features` of one stereo frame, with disparities. Frames in the order of time; any may be
  /// missing.
  LocalizedFrame Localize(Timestamp timestamp, const std::vector<Feature>& features,
                          const std::optional<GpsFix>& gps = std::nullopt);

 private:
  struct LastPose {
    Timestamp timestamp;
    Rigid3 camera_from_map;
    size_t inlier_count = 0;
    Rigid3 this_from_previous;  ///< motion since the pose before
    double interval_s = 0;      ///< that it took; 0 if there was none
  };

  /// Found while all ways to find a pose competed.
  struct Winner {
    Timestamp timestamp;
    size_t inlier_count = 0;
  };

  std::optional<Rigid3> Predict(Timestamp timestamp) const;
  bool IsSure(Timestamp timestamp, const std::optional<TrackedPose>& pose) const;
  std::optional<TrackedPose> TrackFrom(const Rigid3& predicted_camera_from_map,
                                       const FeatureGrid& grid, double radius_factor) const;
  void Remember(Timestamp timestamp, const TrackedPose& pose);

  const ReconstructedMap& map_;
  const StereoRig rig_;
  const LocalizerOptions options_;
  std::optional<LastPose> last_;
  std::optional<Winner> winner_;
};

}  // namespace carmap
