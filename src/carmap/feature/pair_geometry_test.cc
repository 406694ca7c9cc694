#include "carmap/feature/pair_geometry.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <numbers>
#include <random>

#include "carmap/feature/orb_extractor.h"
#include "carmap/feature/test_images.h"

namespace carmap {
namespace {

constexpr double kDegree = std::numbers::pi / 180;
const StereoRig kRig{{700, 700, 620, 180, 1240, 376}, 0.5};

/// What is wrong with a pair.
struct Wrong {
  Eigen::Vector3d turn_rad = Eigen::Vector3d::Zero();
  double below = 0, before = 0, distortion = 0;
  double mismatched = 0;  ///< share of corners
};

Eigen::Vector2d Distorted(const Eigen::Vector2d& px, double distortion) {
  const Eigen::Vector2d centre(kRig.camera.cx, kRig.camera.cy);
  const Eigen::Vector2d at = (px - centre) / kRig.camera.fx;
  return centre + kRig.camera.fx * at * (1 + distortion * at.squaredNorm());
}

/// Corners of a street (road below, façades) at places noisy by a third of a pixel.
std::vector<CornerPair> CornersOfStreet(const Wrong& wrong) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> noise_px(0, 0.3);
  const auto noisy = [&](const Eigen::Vector2d& px) -> Eigen::Vector2d {
    return px + Eigen::Vector2d(noise_px(random), noise_px(random));
  };
  const Eigen::Matrix3d right_from_left =
      Eigen::AngleAxisd(wrong.turn_rad.norm(), wrong.turn_rad.stableNormalized())
          .toRotationMatrix()
          .transpose();
  const Eigen::Vector3d place = kRig.baseline_m * Eigen::Vector3d(1, wrong.below, wrong.before);
  std::vector<CornerPair> corners;
  while (corners.size() < 400) {
    const bool is_road = uniform(random) < 0.4;
    const double side = uniform(random) < 0.5 ? -7 : 7;
    const Eigen::Vector3d p(is_road ? 12 * uniform(random) - 6 : side,
                            is_road ? 1.6 : 6 * uniform(random) - 4.5, 6 + 40 * uniform(random));
    const Eigen::Vector3d in_right = right_from_left * (p - place);
    const Eigen::Vector2d left = kRig.camera.Project(p), right = kRig.camera.Project(in_right);
    if (!kRig.camera.Contains(left) || !kRig.camera.Contains(right)) continue;
    corners.push_back(
        {noisy(Distorted(left, wrong.distortion)), noisy(Distorted(right, wrong.distortion)), 0});
    if (uniform(random) < wrong.mismatched) {
      corners.back().right_px = {1240 * uniform(random),
                                 corners.back().left_px.y() + 80 * uniform(random) - 40};
    }
  }
  return corners;
}

PairGeometry GeometryOf(const Wrong& wrong) {
  return EstimatePairGeometry(kRig.camera, CornersOfStreet(wrong));
}

TEST(EstimatePairGeometry, OfASoundRigIsAllZero) {
  const PairGeometry geometry = GeometryOf({});
  EXPECT_EQ(geometry.matches, 400u);
  EXPECT_GT(geometry.agreeing, 390u);
  EXPECT_LT(geometry.turn_px, 0.2);
  EXPECT_LT(geometry.place_px, 0.2);
  EXPECT_LT(geometry.distortion_px, 0.2);
  EXPECT_LT(std::abs(geometry.before), 5 * geometry.before_sigma);
  EXPECT_EQ(geometry.backward_share, 0);
  EXPECT_LT(geometry.same_place_share, 0.01);
}

TEST(EstimatePairGeometry, FindsTheTurnOfTheRightCamera) {
  const Eigen::Vector3d turn_rad(-0.3 * kDegree, 0, 0.5 * kDegree);
  const PairGeometry geometry = GeometryOf({.turn_rad = turn_rad, .mismatched = 0.3});
  EXPECT_NEAR(geometry.turn_rad.x(), turn_rad.x(), 0.02 * kDegree);
  EXPECT_NEAR(geometry.turn_rad.z(), turn_rad.z(), 0.02 * kDegree);
  EXPECT_GT(geometry.turn_px, 2);
  EXPECT_GT(geometry.agreeing, 260u);
  EXPECT_LT(geometry.agreeing, 310u);
}

TEST(EstimatePairGeometry, FindsHowFarTheVehicleDroveBetweenTheImages) {
  const PairGeometry geometry = GeometryOf({.before = 1.6, .mismatched = 0.2});
  EXPECT_NEAR(geometry.before, 1.6, 0.1);
  EXPECT_GT(geometry.before, 20 * geometry.before_sigma);
  EXPECT_GT(geometry.place_px, 2);
}

TEST(EstimatePairGeometry, FindsTheDistortionOfBothCameras) {
  const PairGeometry geometry = GeometryOf({.distortion = -0.3, .mismatched = 0.2});
  EXPECT_NEAR(geometry.distortion, -0.4, 0.15);  // of undistorted coordinates, to the first order
  EXPECT_LT(geometry.distortion, -3 * geometry.distortion_sigma);
  EXPECT_GT(geometry.distortion_px, 0.6);
  EXPECT_LT(geometry.turn_px, 0.4);
}

TEST(EstimatePairGeometry, TellsExchangedImagesFromUpsideDownOnes) {
  std::vector<CornerPair> exchanged = CornersOfStreet({}), upside_down = exchanged;
  for (CornerPair& corner : exchanged) std::swap(corner.left_px, corner.right_px);
  const Eigen::Vector2d opposite(1239, 375);
  for (CornerPair& corner : upside_down) {
    corner = {opposite - corner.left_px, opposite - corner.right_px, corner.level};
  }
  const PairGeometry of_exchanged = EstimatePairGeometry(kRig.camera, exchanged);
  const PairGeometry of_upside_down = EstimatePairGeometry(kRig.camera, upside_down);
  EXPECT_GT(of_exchanged.backward_share, 0.95);
  EXPECT_GT(of_exchanged.near_below, 0.1);
  EXPECT_GT(of_upside_down.backward_share, 0.95);
  EXPECT_LT(of_upside_down.near_below, -0.1);
}

TEST(EstimatePairGeometry, SeesThatBothImagesAreOne) {
  std::vector<CornerPair> corners = CornersOfStreet({});
  for (CornerPair& corner : corners) corner.right_px = corner.left_px;
  EXPECT_EQ(EstimatePairGeometry(kRig.camera, corners).same_place_share, 1);
}

TEST(EstimatePairGeometry, OfNoCornersTellsNothing) {
  EXPECT_EQ(EstimatePairGeometry(kRig.camera, {}).agreeing, 0u);
}

TEST(MatchCorners, FindsCornersWhereverTheRowsSay) {
  const Wall wall(600, 300, 3);
  const auto features_of = [](const cv::Mat& image) {
    return OrbExtractor().Extract(BuildPyramid(image, {}));
  };
  const std::vector<Feature> left = features_of(wall.Moved(0)),
                             right = features_of(wall.Moved(5 * 12, 5));
  const auto corners = MatchCorners(left, right, 30);
  ASSERT_GT(corners.size(), 200u);
  size_t right_ones = 0;
  for (const CornerPair& corner : corners) {
    const Eigen::Vector2d moved = corner.left_px - corner.right_px - Eigen::Vector2d(12, -1);
    right_ones += moved.norm() < 2 * ScaleOfLevel(corner.level);
  }
  EXPECT_GT(static_cast<double>(right_ones), 0.97 * static_cast<double>(corners.size()));
  EXPECT_TRUE(MatchCorners(left, {}, 30).empty());
}

}  // namespace
}  // namespace carmap
