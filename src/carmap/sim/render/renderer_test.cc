#include "carmap/sim/render/renderer.h"

#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <cmath>
#include <functional>
#include <opencv2/core.hpp>

#include "carmap/sim/render/test_street.h"

namespace carmap {
namespace {

using Eigen::Vector3d;

constexpr double kBaselineM = 0.54;
constexpr double kHeightM = 1.65;
const PinholeCamera kCamera{360, 360, 303.5, 92.6, 620, 188};

/// Looks along x of the world.
Rigid3 LookingEast(double x, double y) {
  Eigen::Matrix3d enu_from_camera;
  enu_from_camera << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return {Eigen::Quaterniond(enu_from_camera), {x, y, kHeightM}};
}

std::shared_ptr<World> WorldOf(std::vector<Mesh> models) {
  auto world = std::make_shared<World>();
  world->ground = std::make_shared<FlatGround>();
  world->models = std::move(models);
  for (uint32_t i = 0; i < world->models.size(); ++i) world->tiles.push_back({.model_idx = i});
  return world;
}

Light Sunny() { return MakeLight(Weather::kSunny, 3); }

/// Share of the pixels within `area` whose disparity agrees to 0.05 px with that of the point that
/// `depth_at` gives, 0 for those to be left out.
double AgreementIn(const cv::Mat& depth_m, const cv::Rect& area,
                   const std::function<double(cv::Point)>& depth_at) {
  int good = 0, all = 0;
  for (int y = area.y; y < area.br().y; ++y) {
    for (int x = area.x; x < area.br().x; ++x) {
      const double truth = depth_at({x, y});
      if (truth == 0) continue;
      const double error = kCamera.fx * kBaselineM * (1 / depth_m.at<float>(y, x) - 1 / truth);
      ++all;
      good += std::abs(error) <= 0.05 ? 1 : 0;
    }
  }
  EXPECT_GT(all, 100);
  return static_cast<double>(good) / all;
}

double GroundDepthAt(cv::Point px) { return kHeightM * kCamera.fy / (px.y - kCamera.cy); }

TEST(Renderer, GroundLiesWhereThePlaneIsWhereverInTheWorld) {
  const Vector3d far_away(7300.25, -4100.5, 0);
  auto world = WorldOf({GroundMesh(1000)});
  world->tiles[0].position_in_enu = far_away;
  Rigid3 pose = LookingEast(10.1, 3.3);
  pose.translation += far_away;
  const RenderedView view = Renderer(world, {}, Sunny(), 1).Render(kCamera, pose, {});
  EXPECT_EQ(AgreementIn(view.depth_m, {0, 96, kCamera.width, kCamera.height - 96}, GroundDepthAt),
            1);
  EXPECT_EQ(view.labels.at<uint8_t>(20, 300), static_cast<uint8_t>(SemanticClass::kSky));
  EXPECT_EQ(view.depth_m.at<float>(20, 300), 0);
}

TEST(Renderer, TurnedAndScaledBoxLiesWhereItsPlanesAre) {
  auto world = WorldOf({BoxMesh({2, 3, 1}, {.label = SemanticClass::kBuilding}), GroundMesh(1000)});
  world->tiles[0] = {.model_idx = 0,
                     .position_in_enu = {12, -1, 0},
                     .heading_rad = 0.4f,
                     .pitch_rad = 0.1f,
                     .scale = 2};
  const Rigid3 pose = LookingEast(0, 0);
  const RenderedView view = Renderer(world, {}, Sunny(), 1).Render(kCamera, pose, {});
  // In the frame of the box: nose up by the pitch, then to the left by the heading.
  const Eigen::Matrix3d turn =
      (Eigen::AngleAxisd(0.4f, Vector3d::UnitZ()) * Eigen::AngleAxisd(-0.1f, Vector3d::UnitY()))
          .toRotationMatrix();
  const Eigen::AlignedBox3d box(Vector3d(-2, -3, 0), Vector3d(2, 3, 2));
  int on_box = 0, labels_agree = 0;
  const auto depth_at = [&](cv::Point px) {
    const Vector3d ray_in_enu = pose.rotation * kCamera.Unproject(Eigen::Vector2d(px.x, px.y), 1);
    const Vector3d from = turn.transpose() * (pose.translation - Vector3d(12, -1, 0));
    const Vector3d ray = turn.transpose() * ray_in_enu;
    const Vector3d a = (box.min() - from).cwiseQuotient(ray);
    const Vector3d b = (box.max() - from).cwiseQuotient(ray);
    const double in = a.cwiseMin(b).maxCoeff(), out = a.cwiseMax(b).minCoeff();
    const double ground = ray_in_enu.z() < 0 ? -kHeightM / ray_in_enu.z() : 1e9;
    if (in >= out || in > ground) return 0.;
    ++on_box;
    labels_agree += view.labels.at<uint8_t>(px) == static_cast<uint8_t>(SemanticClass::kBuilding);
    return in;
  };
  EXPECT_GT(AgreementIn(view.depth_m, {0, 0, kCamera.width, kCamera.height}, depth_at), 0.99);
  EXPECT_GT(labels_agree, 0.99 * on_box);
}

TEST(Renderer, BallLiesWhereTheSphereIs) {
  MeshBuilder builder;
  builder.Ellipsoid({8, 0.3f, 1.5f}, {1, 1, 1}, 200, 100, builder.Use({}));
  const RenderedView view = Renderer(WorldOf({std::move(builder).Build()}), {}, Sunny(), 1)
                                .Render(kCamera, LookingEast(0, 0), {});
  const Vector3d centre(-0.3, kHeightM - 1.5, 8);
  const auto depth_at = [&](cv::Point px) {
    const Vector3d ray = kCamera.Unproject(Eigen::Vector2d(px.x, px.y), 1);
    const double along = ray.dot(centre), length2 = ray.squaredNorm();
    const double root = along * along - length2 * (centre.squaredNorm() - 1);
    // But for the silhouette, where the mesh's corners show.
    return root < 0.1 * along ? 0. : (along - std::sqrt(root)) / length2;
  };
  EXPECT_GT(AgreementIn(view.depth_m, {0, 0, kCamera.width, kCamera.height}, depth_at), 0.99);
}

TEST(Renderer, TheRightViewAgreesWithTheLeft) {
  const Renderer renderer(TestStreet(40), {}, Sunny(), 1);
  const RenderedView left = renderer.Render(kCamera, LookingEast(0, -1.8), {});
  const RenderedView right = renderer.Render(kCamera, LookingEast(0, -1.8 - kBaselineM), {});
  int good = 0, all = 0;
  for (int y = 0; y < kCamera.height; ++y) {
    for (int x = 0; x < kCamera.width; ++x) {
      const float z = left.depth_m.at<float>(y, x);
      const double disparity = z == 0 ? 0 : kCamera.fx * kBaselineM / z;
      const double u = x - disparity;
      const int i = static_cast<int>(std::floor(u));
      if (z == 0 || i < 1 || i + 2 >= kCamera.width) continue;
      const auto seen = [&](int column) {
        return kCamera.fx * kBaselineM / right.depth_m.at<float>(y, column);
      };
      const double a = seen(i), b = seen(i + 1);
      // Leaves and edges, and what the right camera does not see.
      const double bend = std::max(std::abs(seen(i - 1) - 2 * a + b),  //
                                   std::abs(a - 2 * b + seen(i + 2)));
      if (!(bend < 0.02) || a > disparity + 0.5) continue;
      ++all;
      good += std::abs(a + (u - i) * (b - a) - disparity) < 0.05 ? 1 : 0;
    }
  }
  EXPECT_GT(all, kCamera.width * kCamera.height / 4);
  EXPECT_GT(good, 0.99 * all);
}

TEST(Renderer, AResidualOfRectificationShiftsWhatIsSeen) {
  auto world = WorldOf({BoxMesh({2, 3, 1}, {.label = SemanticClass::kBuilding}), GroundMesh(1000)});
  world->tiles[0].position_in_enu = {12, -1, 0};
  const Renderer renderer(world, {}, Sunny(), 1);
  RectificationResidual residual;
  residual.column[0] = static_cast<float>(3 / kCamera.fx);
  residual.row[0] = static_cast<float>(-2 / kCamera.fy);
  PinholeCamera shifted = kCamera;
  shifted.cx -= 3;
  shifted.cy += 2;
  const RenderedView expected = renderer.Render(shifted, LookingEast(0, 0), {});
  const RenderedView view = renderer.Render(kCamera, LookingEast(0, 0), {}, residual);
  EXPECT_LT(cv::norm(view.depth_m, expected.depth_m, cv::NORM_L1) / view.depth_m.total(), 0.01);
  residual = {};
  residual.column[3] = static_cast<float>(200 / kCamera.fx);
  const RenderedView bent = renderer.Render(kCamera, LookingEast(0, 0), {}, residual);
  // The middle column stays, where x is 0.
  const RenderedView straight = renderer.Render(kCamera, LookingEast(0, 0), {});
  for (int y = 0; y < kCamera.height; ++y) {
    EXPECT_NEAR(bent.depth_m.at<float>(y, 303), straight.depth_m.at<float>(y, 303), 1e-2);
  }
  EXPECT_GT(cv::norm(bent.depth_m, straight.depth_m, cv::NORM_INF), 1);
}

TEST(Renderer, SameBytesWithAnyNumberOfThreads) {
  const Renderer renderer(TestStreet(60), {}, Sunny(), 1);
  const auto render = [&](size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    return renderer.Render(kCamera, LookingEast(0, -1.8), {.velocity_in_camera = {0, 0, 10}});
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
}

TEST(Renderer, TrafficAppearsAndGoes) {
  Renderer renderer(WorldOf({GroundMesh(1000)}), {CarMesh()}, Sunny(), 1);
  const Rigid3 pose = LookingEast(0, 0);
  const RenderedView before = renderer.Render(kCamera, pose, {});
  renderer.SetTraffic({{.model_idx = 1,
                        .position_in_enu = {12, 0, 0},
                        .mobility = PlacementMobility::kMoving,
                        .instance = 7}});
  const RenderedView with_car = renderer.Render(kCamera, pose, {});
  const auto at = kCamera.Project({0, 1.1, 9.9});  // its rear, 0.55 m above the ground
  const cv::Point px(static_cast<int>(at.x()), static_cast<int>(at.y()));
  EXPECT_EQ(before.instances.at<uint16_t>(px), 0);
  EXPECT_EQ(with_car.instances.at<uint16_t>(px), 7);
  EXPECT_EQ(with_car.mobilities.at<uint8_t>(px), static_cast<uint8_t>(PlacementMobility::kMoving));
  EXPECT_EQ(with_car.labels.at<uint8_t>(px), static_cast<uint8_t>(SemanticClass::kCar));
  EXPECT_NEAR(with_car.depth_m.at<float>(px), 9.9, 1e-3);
  renderer.SetTraffic({});
  const RenderedView after = renderer.Render(kCamera, pose, {});
  EXPECT_EQ(cv::norm(after.radiance, before.radiance, cv::NORM_INF), 0);
}

TEST(Renderer, MotionIsThatOfThePoints) {
  const Renderer renderer(WorldOf({GroundMesh(1000)}), {}, Sunny(), 1);
  const Vector3d velocity(0.3, 0, 9), turning(0.01, 0.2, 0);
  const RenderedView view =
      renderer.Render(kCamera, LookingEast(0, 0),
                      {.velocity_in_camera = velocity, .angular_velocity_in_camera = turning});
  const double step_s = 1e-4;
  const Rigid3 next_from_camera =
      Rigid3{RotationExp(turning * step_s), velocity * step_s}.Inverse();
  for (const cv::Point px : {cv::Point(40, 150), cv::Point(500, 120)}) {
    const Eigen::Vector2d start(px.x, px.y);
    const Vector3d point = kCamera.Unproject(start, view.depth_m.at<float>(px));
    const Eigen::Vector2d motion = (kCamera.Project(next_from_camera * point) - start) / step_s;
    const auto& stated = view.motion_px.at<cv::Vec2f>(px);
    EXPECT_NEAR(stated[0], motion.x(), 0.01 * motion.norm());
    EXPECT_NEAR(stated[1], motion.y(), 0.01 * motion.norm());
  }
}

TEST(Renderer, ThingsStandInShadow) {
  Light light = Sunny();
  light.to_sun_in_enu = Vector3d(0, -1, 1).normalized();
  auto world = WorldOf({GroundMesh(1000), BoxMesh({4, 0.2f, 3}, {})});
  world->tiles[1].position_in_enu = {15, 0, 0};
  const RenderedView view = Renderer(world, {}, light, 1).Render(kCamera, LookingEast(0, 0), {});
  const auto radiance_at = [&](double x, double y) {
    const auto px = kCamera.Project({-y, kHeightM, x});
    return cv::mean(view.radiance(
        cv::Rect(static_cast<int>(px.x()) - 2, static_cast<int>(px.y()) - 1, 5, 3)))[0];
  };
  EXPECT_LT(radiance_at(14, 1.5), 0.5 * radiance_at(10, 1.5));  // its shadow falls to the left
  EXPECT_NEAR(radiance_at(14, -3), radiance_at(11, -3), 0.2 * radiance_at(11, -3));
}

/// A wall square to the view, papered with `pattern`, without shadows.
cv::Mat WallSeenFrom(Pattern pattern, double distance_m, double y) {
  MeshBuilder builder;
  const auto wall = builder.Use({.pattern = pattern});
  builder.Quad({0, 30, 0}, {0, -30, 0}, {0, -30, 12}, {0, 30, 12}, wall);
  const Renderer renderer(WorldOf({std::move(builder).Build()}), {},
                          MakeLight(Weather::kOvercast, 1), 1);
  const RenderedView view = renderer.Render(kCamera, LookingEast(-distance_m, y), {});
  return view.radiance(cv::Rect(200, 70, 200, 28)).clone();
}

double RelativeDeviation(const cv::Mat& image) {
  cv::Scalar mean, deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0] / mean[0];
}

TEST(Renderer, GrainFadesWithDistance) {
  for (const Pattern pattern : {Pattern::kAsphalt, Pattern::kCobbles}) {
    const double near = RelativeDeviation(WallSeenFrom(pattern, 4, 0));
    const double middle = RelativeDeviation(WallSeenFrom(pattern, 12, 0));
    const double far = RelativeDeviation(WallSeenFrom(pattern, 60, 0));
    EXPECT_GT(near, 0.1);
    EXPECT_LT(middle, 0.8 * near);
    EXPECT_LT(far, 0.8 * middle);
  }
}

TEST(Renderer, GrainKeepsItsPlaceWhenTheCameraMoves) {
  const double distance = 20;
  for (const Pattern pattern : {Pattern::kAsphalt, Pattern::kBrick, Pattern::kLeaves}) {
    const double pixel_m = distance / kCamera.fx;
    const cv::Mat start = WallSeenFrom(pattern, distance, 0);
    const cv::Mat moved = WallSeenFrom(pattern, distance, -0.5 * pixel_m);
    // Half a pixel to the right: what was seen lies half a pixel to the left.
    const cv::Rect left(0, 0, start.cols - 1, start.rows), right(1, 0, start.cols - 1, start.rows);
    const cv::Mat predicted = 0.5 * (start(left) + start(right));
    const double change = cv::norm(predicted, moved(left), cv::NORM_L2);
    const cv::Mat detail = start - cv::mean(start)[0];
    // White grain averaged over each pixel would give 0.71, looked up at points 1.22.
    EXPECT_LT(change, 0.75 * cv::norm(detail, cv::NORM_L2)) << static_cast<int>(pattern);
  }
}

}  // namespace
}  // namespace carmap
