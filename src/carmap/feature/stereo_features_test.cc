#include "carmap/feature/stereo_features.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "carmap/feature/test_images.h"

namespace carmap {
namespace {

StereoRig RigOfSize(int width, int height) {
  return {{0.8 * width, 0.8 * width, width / 2.0, height / 2.0, width, height}, 0.5};
}

TEST(Enlarged, SeesAPointWhereTheLargerImageShowsIt) {
  const StereoRig rig = RigOfSize(320, 120);
  const StereoRig enlarged = Enlarged(rig, 2);
  const Eigen::Vector3d p_in_camera(2, -0.5, 9);
  const Eigen::Vector3d uvd = rig.Project(p_in_camera), larger = enlarged.Project(p_in_camera);
  EXPECT_NEAR(larger.x() + 0.5, 2 * (uvd.x() + 0.5), 1e-9);
  EXPECT_NEAR(larger.y() + 0.5, 2 * (uvd.y() + 0.5), 1e-9);
  EXPECT_NEAR(larger.z(), 2 * uvd.z(), 1e-9);
}

TEST(StereoFrontEnd, SmallImagesAreSearchedEnlarged) {
  EXPECT_EQ(StereoFrontEnd(RigOfSize(1241, 376)).rig(), RigOfSize(1241, 376));
  for (const int width : {304, 397, 620}) {
    const StereoRig rig = RigOfSize(width, width / 3);
    EXPECT_EQ(StereoFrontEnd(rig).rig(), Enlarged(rig, 2)) << width;
  }
}

TEST(StereoFrontEnd, ASmallImageHasFeaturesNearItsBordersWithTrueDepth) {
  const Wall wall(304, 126, 3);
  StereoFrontEnd front_end(RigOfSize(304, 126));
  const auto features = front_end.Extract(wall.Moved(0), wall.Moved(5 * 12));
  ASSERT_GT(features.size(), 500u);
  const double scale = front_end.rig().camera.width / 304.0;
  float top_px = 1e9f, bottom_px = 0;
  std::vector<double> errors_px;
  for (const Feature& feature : features) {
    top_px = std::min(top_px, feature.y_px);
    bottom_px = std::max(bottom_px, feature.y_px);
    if (feature.has_disparity()) errors_px.push_back(std::abs(feature.disparity_px / scale - 12));
  }
  EXPECT_LT(top_px / scale, 10);
  EXPECT_GT(bottom_px / scale, 126 - 10);
  std::nth_element(errors_px.begin(), errors_px.begin() + errors_px.size() / 2, errors_px.end());
  EXPECT_LT(errors_px[errors_px.size() / 2], 0.05);
}

size_t CountDepths(const std::vector<Feature>& features) {
  return static_cast<size_t>(
      std::count_if(features.begin(), features.end(),
                    [](const Feature& feature) { return feature.has_disparity(); }));
}

TEST(StereoFrontEnd, DepthsDoNotDependOnTheRightCamerasGain) {
  const Wall wall(600, 200, 3);
  StereoFrontEnd front_end(RigOfSize(600, 200));
  const cv::Mat left = wall.Moved(0), right = wall.Moved(5 * 12);
  const size_t with_equal_cameras = CountDepths(front_end.Extract(left, right));
  ASSERT_GT(with_equal_cameras, 500u);
  for (const double gain : {0.4, 0.6, 1.3}) {
    cv::Mat other;
    right.convertTo(other, CV_8U, gain);
    EXPECT_GT(CountDepths(front_end.Extract(left, other)), with_equal_cameras * 9 / 10) << gain;
    EXPECT_NEAR(front_end.brightness_ratio(), gain, 0.05);
  }
}

TEST(StereoFrontEnd, UndoesTheTurnOfTheRightCamera) {
  const Wall wall(600, 200, 3);
  const StereoRig rig = RigOfSize(600, 200);
  const double turn_rad = 0.6 * std::numbers::pi / 180;
  const cv::Mat about_axis =
      cv::getRotationMatrix2D(cv::Point2f(300, 100), turn_rad * 180 / std::numbers::pi, 1.0);
  const cv::Mat left = wall.Moved(0);
  cv::Mat right = wall.Moved(5 * 12);
  StereoFrontEnd straight(rig);
  const size_t of_sound_rig = CountDepths(straight.Extract(left, right));
  cv::warpAffine(right, right, about_axis, right.size(), cv::INTER_CUBIC, cv::BORDER_REFLECT);
  const auto features = straight.Extract(left, right);
  EXPECT_LT(CountDepths(features), of_sound_rig * 3 / 4);
  const PairGeometry geometry = straight.MeasurePair(features);
  EXPECT_NEAR(geometry.turn_rad.z(), turn_rad, 0.1 * turn_rad);

  StereoFrontEnd straightened(rig, {.misalignment = {.turn = geometry.turn_rad.z()}});
  EXPECT_GT(CountDepths(straightened.Extract(left, right)), of_sound_rig * 9 / 10);
}

}  // namespace
}  // namespace carmap
