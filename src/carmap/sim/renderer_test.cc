#include "carmap/sim/renderer.h"

#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "carmap/sim/sensor.h"
#include "carmap/sim/test_street.h"

namespace carmap {
namespace {

constexpr double kBaselineM = 0.54;

PinholeCamera SmallCamera() { return {360, 360, 303.5, 92.6, 620, 188}; }

/// Looks along x from 1.65 m above the ground.
Rigid3 LookingEast(double x, double y) {
  Eigen::Matrix3d enu_from_camera;
  enu_from_camera << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return {Eigen::Quaterniond(enu_from_camera), {x, y, 1.65}};
}

class RendererTest : public testing::Test {
 protected:
  const PinholeCamera camera_ = SmallCamera();
  const Light light_ = MakeLight(Weather::kSunny, 3);
};

double ShareOfDisparitiesWithin(const cv::Mat& depth, const cv::Mat& truth, const cv::Mat& mask,
                                double tolerance_px) {
  int good = 0, all = 0;
  for (int y = 0; y < depth.rows; ++y) {
    for (int x = 0; x < depth.cols; ++x) {
      if (mask.at<uint8_t>(y, x) == 0) continue;
      ++all;
      const double fb = SmallCamera().fx * kBaselineM;
      const double error = fb / depth.at<float>(y, x) - fb / truth.at<float>(y, x);
      good += std::abs(error) <= tolerance_px ? 1 : 0;
    }
  }
  return all == 0 ? 0 : static_cast<double>(good) / all;
}

TEST_F(RendererTest, GroundLiesWhereThePlaneIsWhereverInTheWorld) {
  auto world = std::make_shared<World>();
  world->ground = std::make_shared<FlatGround>();
  world->models.push_back(GroundMesh(1000));
  const Eigen::Vector3d far_away(7300.25, -4100.5, 0);
  world->tiles.push_back({.model_idx = 0, .position_in_enu = far_away});
  const Renderer renderer(world, {}, light_, 1);
  Rigid3 pose = LookingEast(10.1, 3.3);
  pose.translation += far_away;
  const RenderedView view = renderer.Render(camera_, pose, {});
  cv::Mat truth(camera_.height, camera_.width, CV_32F, cv::Scalar(0));
  cv::Mat mask(camera_.height, camera_.width, CV_8U, cv::Scalar(0));
  for (int y = 100; y < camera_.height; ++y) {
    truth.row(y).setTo(1.65 * camera_.fy / (y - camera_.cy));
    mask.row(y).setTo(255);
  }
  EXPECT_EQ(ShareOfDisparitiesWithin(view.depth_m, truth, mask, 0.05), 1);
  EXPECT_EQ(view.labels.at<uint8_t>(20, 300), static_cast<uint8_t>(SemanticClass::kSky));
  EXPECT_EQ(view.depth_m.at<float>(20, 300), 0);
}

TEST_F(RendererTest, SameBytesWithAnyNumberOfThreads) {
  const Renderer renderer(TestStreet(100), {}, light_, 1);
  const auto render = [&](size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return renderer.Render(camera_, LookingEast(0, -1.8), {.velocity_in_camera = {0, 0, 10}});
  };
  const RenderedView one = render(1), two = render(2);
  const auto same = [](const cv::Mat& a, const cv::Mat& b) {
    return cv::norm(a.reshape(1), b.reshape(1), cv::NORM_INF) == 0;
  };
  EXPECT_TRUE(same(one.radiance, two.radiance));
  EXPECT_TRUE(same(one.depth_m, two.depth_m));
  EXPECT_TRUE(same(one.labels, two.labels));
  EXPECT_TRUE(same(one.instances, two.instances));
  EXPECT_TRUE(same(one.motion_px, two.motion_px));
  EXPECT_TRUE(same(Expose(one, {}, 2, 0, 0), Expose(two, {}, 2, 0, 0)));
}

TEST_F(RendererTest, TrafficAppearsAndGoes) {
  auto world = std::make_shared<World>();
  world->ground = std::make_shared<FlatGround>();
  world->models.push_back(GroundMesh(1000));
  world->tiles.push_back({.model_idx = 0});
  Renderer renderer(world, {CarMesh()}, light_, 1);
  const Rigid3 pose = LookingEast(0, 0);
  const RenderedView before = renderer.Render(camera_, pose, {});
  renderer.SetTraffic({{.model_idx = 1,
                        .position_in_enu = {12, 0, 0},
                        .mobility = Mobility::kMoving,
                        .instance = 7}});
  const RenderedView with_car = renderer.Render(camera_, pose, {});
  const auto at = camera_.Project({0, 1.1, 9.9});  // its rear, 0.55 m above the ground
  const cv::Point px(static_cast<int>(at.x()), static_cast<int>(at.y()));
  EXPECT_EQ(with_car.instances.at<uint16_t>(px), 7);
  EXPECT_EQ(with_car.mobilities.at<uint8_t>(px), static_cast<uint8_t>(Mobility::kMoving));
  EXPECT_EQ(with_car.labels.at<uint8_t>(px), static_cast<uint8_t>(SemanticClass::kCar));
  EXPECT_NEAR(with_car.depth_m.at<float>(px), 9.9, 1e-3);
  renderer.SetTraffic({});
  const RenderedView after = renderer.Render(camera_, pose, {});
  EXPECT_EQ(cv::norm(after.radiance, before.radiance, cv::NORM_INF), 0);
}

}  // namespace
}  // namespace carmap
