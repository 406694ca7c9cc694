// The vehicle's front end: features with depth of a stereo frame.
#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "carmap/feature/feature.h"
#include "carmap/feature/orb_extractor.h"
#include "carmap/feature/pair_geometry.h"
#include "carmap/feature/stereo_matcher.h"
#include "carmap/geometry/camera.h"

namespace carmap {

/// By how much the right image lies lower and is turned clockwise about its principal point,
/// against its calibration: PairGeometry::turn_rad about x and z, radians.
struct RowMisalignment {
  double down = 0, turn = 0;
  bool operator==(const RowMisalignment&) const = default;
};

struct FrontEndOptions {
  OrbOptions orb;
  StereoOptions stereo;
  RowMisalignment misalignment;  ///< of the right image, to be undone
};

/// Wall-clock time of the front end's stages. The right image's pyramid is built beside what is
/// done with the left image, `pyramid_ms` and `extract_ms`.
struct FrontEndTimes {
  double pyramid_ms = 0, extract_ms = 0, stereo_ms = 0;
};

/// How many times the images of a camera are enlarged before features are looked for. A corner of
/// a small image can be placed better, and nearer to the border, than the detector's whole pixels
/// and the signature's patch allow.
int EnlargementFor(const PinholeCamera& camera);

/// The rig whose images are so many times larger.
StereoRig Enlarged(const StereoRig& rig, int factor);

/// For one frame at a time, on all cores; the result does not depend on how many there are. Its
/// working memory is kept for the next frame.
class StereoFrontEnd {
 public:
  explicit StereoFrontEnd(const StereoRig& camera_rig, const FrontEndOptions& options = {})
      : enlargement_(EnlargementFor(camera_rig.camera)),
        rig_(Enlarged(camera_rig, enlargement_)),
        orb_(options.orb),
        stereo_options_(options.stereo),
        misalignment_(options.misalignment) {}

  /// The rig in whose pixels features are: the camera's, enlarged if its images are small.
  const StereoRig& rig() const { return rig_; }

  /// Images: CV_8UC1 of the camera's size, rectified.
  std::vector<Feature> Extract(const cv::Mat& left, const cv::Mat& right,
                               FrontEndTimes* times = nullptr);

  /// How the cameras really stand in the pair whose left image gave these features: that of the
  /// last call of Extract.
  PairGeometry MeasurePair(const std::vector<Feature>& left);

  /// Of the last pair: how many times as bright its right image was.
  double brightness_ratio() const { return brightness_ratio_; }

  /// An image of the camera at the size in which features are.
  cv::Mat AtFeatureSize(const cv::Mat& image) const;
  /// The same of a right image, put right where it is misaligned.
  cv::Mat RightAtFeatureSize(const cv::Mat& right) const { return Aligned(AtFeatureSize(right)); }

 private:
  cv::Mat Aligned(const cv::Mat& right) const;

  const int enlargement_;
  const StereoRig rig_;
  OrbExtractor orb_;
  const StereoOptions stereo_options_;
  const RowMisalignment misalignment_;
  double brightness_ratio_ = 1;
  ImagePyramid left_, right_;
};

}  // namespace carmap
