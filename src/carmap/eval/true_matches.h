// Which features of two successive frames are the same point of the world, told by place alone.
//
// Whoever matches by descriptor cannot say afterwards how far descriptors of the same point lie
// apart: those far apart were not matched. Here a feature with depth is projected into the next
// frame by the camera's motion, and its true match is the feature that lies where it must appear.
// Pure functions, thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/feature_grid.h"
#include "carmap/geometry/camera.h"
#include "carmap/geometry/rigid3.h"

namespace carmap {

/// Motion of the camera between two frames, by the localizer's own means: matches in appearance,
/// PnP, refinement. Hundreds of inliers make it good to a few millimetres, where a GPS/IMU unit is
/// off by centimetres. Nothing if too few agree.
std::optional<Rigid3> EstimateMotion(const std::vector<Feature>& from,
                                     const std::vector<Feature>& to, const StereoRig& rig);

/// Where a feature of the frame before must appear.
struct PredictedFeature {
  uint32_t feature_idx = 0;                       ///< of the frame before
  Eigen::Vector3d uvd = Eigen::Vector3d::Zero();  ///< u, v and disparity without bias, pixels
  double level = 0;  ///< at which its size in the image falls, not rounded
};

/// The features with depth that the next frame must show: inside the image, away from its edges by
/// as much as the extractor keeps, and on a level that exists.
std::vector<PredictedFeature> PredictFeatures(const std::vector<Feature>& from,
                                              const Rigid3& to_from_from, const StereoRig& rig);

/// How far a true match may lie from its prediction, in pixels of its level, in u, v and disparity;
/// and how many levels apart.
struct TrueMatchOptions {
  double max_distance_px = 2;
  double max_level_difference = 1.5;
};

struct TrueMatch {
  uint32_t prediction_idx = 0;
  uint32_t feature_idx = 0;  ///< of the next frame
  double distance_px = 0;    ///< from the predicted place, in pixels of its level
};

/// For each prediction the feature nearest in place that fits, if it is nearer to it than to any
/// other prediction: one to one, in the order of the predictions.
std::vector<TrueMatch> FindTrueMatches(const std::vector<PredictedFeature>& predictions,
                                       const FeatureGrid& to, const StereoRig& rig,
                                       const TrueMatchOptions& options = {});

/// Whether the true match could be mistaken: a feature elsewhere within `window_px` (half side of a
/// square) of the predicted place, on a level as near, resembles `descriptor` almost as much as the
/// true match does: by less than a quarter, or by two bits. Features at the true match's own place
/// are the same corner on another level, and no other.
bool IsAmbiguous(const Descriptor& descriptor, const PredictedFeature& prediction,
                 const TrueMatch& match, const FeatureGrid& to, double window_px,
                 const TrueMatchOptions& options = {});

}  // namespace carmap
