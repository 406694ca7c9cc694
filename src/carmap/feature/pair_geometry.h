// How the right camera really stands to the left one, as the images of one frame show it.
//
// Corners are matched in the whole images, without the help of the calibration, so that a rig that
// is not what its calibration says, or images that do not belong together, show themselves. Pure
// functions.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/geometry/camera.h"

namespace carmap {

/// A corner in both images of a pair, in pixels of the full-size images.
struct CornerPair {
  Eigen::Vector2d left_px = Eigen::Vector2d::Zero(), right_px = Eigen::Vector2d::Zero();
  int level = 0;  ///< of the coarser of its two features
};

/// Features of both images that resemble each other most, mutually, and nothing elsewhere as much.
/// `max_rows_px`: by which they may differ.
std::vector<CornerPair> MatchCorners(const std::vector<Feature>& left,
                                     const std::vector<Feature>& right, double max_rows_px);

/// What explains the rows by which the corners of a pair differ, to the first order. All zero of a
/// rig as it is calibrated whose images belong together.
struct PairGeometry {
  size_t matches = 0;   ///< corners found in both images
  size_t agreeing = 0;  ///< of them with what follows
  /// Turn of the right camera, radians about x (right), y (down) and z (forward).
  Eigen::Vector3d turn_rad = Eigen::Vector3d::Zero();
  /// Its place below and before the calibrated one, in baselines. Images taken one after the other
  /// by a moving vehicle look as if the cameras stood one before the other.
  double below = 0, before = 0;
  /// First radial distortion coefficient of both images, of coordinates divided by the focal
  /// length; negative of a barrel.
  double distortion = 0;
  /// Root mean square of the rows that each of these explains, of all agreeing corners, pixels.
  double turn_px = 0, place_px = 0, distortion_px = 0;
  double rows_px = 0;                             ///< the same of all of them together
  double before_sigma = 0, distortion_sigma = 0;  ///< standard deviations
  /// Shares of the agreeing corners: of which the right image shows the same pixel; that lie as
  /// none can before two cameras, right of where the left image has them, by more than a pixel.
  double same_place_share = 0, backward_share = 0;
  /// Correlation of the disparity's size with the row: the road below is near, so positive in an
  /// upright camera.
  double near_below = 0;
};

/// The least error in the rows, outliers left out by degrees (graduated non-convexity, Yang et al.
/// 2020). `camera`: in whose pixels corners are. Below kMinAgreeing agreeing corners it tells
/// nothing.
PairGeometry EstimatePairGeometry(const PinholeCamera& camera,
                                  const std::vector<CornerPair>& corners);

inline constexpr size_t kMinAgreeing = 40;

}  // namespace carmap
