#include "carmap/slam/georeference_map.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>

#include "carmap/map/map_edit.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::IsEmpty;
using ::testing::Le;
using ::testing::SizeIs;

constexpr DriveId kDrive{7};
constexpr int kCount = 120;
const GpsFix kOrigin{49.011, 8.416, 115};

/// Where the drive's frame lies: its z points north-east, its y down.
Rigid3 EnuFromMap() {
  Eigen::Matrix3d axes;  // columns: right, down, ahead
  axes << M_SQRT1_2, 0, M_SQRT1_2, -M_SQRT1_2, 0, M_SQRT1_2, 0, -1, 0;
  return {Eigen::Quaterniond(axes), {20, -30, 5}};
}

using FixOf = std::function<std::optional<GpsFix>(int, const Eigen::Vector3d& p_in_enu)>;

/// A bent street, a keyframe every 2 m and 0.2 s.
Map MapWithFixes(const FixOf& fix_of) {
  MapEdit edit;
  for (int i = 0; i < kCount; ++i) {
    Keyframe keyframe{.id = {kDrive, static_cast<uint32_t>(i)}};
    keyframe.timestamp = Timestamp::FromSeconds(0.2 * i);
    keyframe.map_from_camera = {RotationExp({0, 0.01 * i, 0}), {0.01 * i * i, 0, 2.0 * i}};
    keyframe.gps = fix_of(i, EnuFromMap() * keyframe.map_from_camera.translation);
    keyframe.features = std::make_shared<const std::vector<Feature>>();
    edit.added_keyframes.push_back(keyframe);
  }
  Map map;
  EXPECT_EQ(*Apply(edit, map), 0u);
  return map;
}

GpsFix ExactFix(const Eigen::Vector3d& p_in_enu) { return LocalEnu(kOrigin).ToGps(p_in_enu); }

double WorstErrorM(const Map& map, const Georeference& georeference) {
  const LocalEnu enu(georeference.origin), true_enu(kOrigin);
  double worst = 0;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const Eigen::Vector3d& p_in_map = keyframe.map_from_camera.translation;
    const Eigen::Vector3d found = true_enu.FromGps(enu.ToGps(georeference.enu_from_map * p_in_map));
    worst = std::max(worst, (found - EnuFromMap() * p_in_map).norm());
  }
  return worst;
}

TEST(GeoreferenceMap, ExactFixesTellItExactly) {
  const Map map = MapWithFixes([](int, const auto& p) { return ExactFix(p); });
  const auto georeference = GeoreferenceOf(map, {});
  ASSERT_TRUE(georeference);
  EXPECT_LT(WorstErrorM(map, *georeference), 0.01);
  EXPECT_THAT(FixErrorsM(map, *georeference), AllOf(SizeIs(kCount), Each(Le(0.01))));
}

TEST(GeoreferenceMap, FixesFarOffDoNotBendIt) {
  StreetRandom random(3);
  const Map map = MapWithFixes([&](int i, Eigen::Vector3d p) {
    for (int axis = 0; axis < 3; ++axis) p[axis] += random.Normal(1.5);
    if (i % 40 < 12) p += Eigen::Vector3d(50, -40, 10);
    return ExactFix(p);
  });
  const auto georeference = GeoreferenceOf(map, {});
  ASSERT_TRUE(georeference);
  EXPECT_LT(WorstErrorM(map, *georeference), 1.5);
  const auto errors_m = FixErrorsM(map, *georeference);
  EXPECT_EQ(std::count_if(errors_m.begin(), errors_m.end(), [](double e) { return e > 40; }), 36);
}

TEST(GeoreferenceMap, AFixElsewhereOnTheEarthChangesNothing) {
  const GpsFix elsewhere[] = {{52.52, 13.4, 30}, {49.511, 8.416, 115}, {-33.9, 151.2, 10}};
  for (const GpsFix& wrong : elsewhere) {
    for (const int index : {0, 50, kCount - 1}) {
      const Map map =
          MapWithFixes([&](int i, const auto& p) { return i == index ? wrong : ExactFix(p); });
      const auto georeference = GeoreferenceOf(map, {});
      ASSERT_TRUE(georeference) << index;
      EXPECT_LT(WorstErrorM(map, *georeference), 0.01) << index;
    }
  }
}

TEST(GeoreferenceMap, FixesOfAnotherWayTellNothing) {
  // Of a street that is half as long again.
  const Map map = MapWithFixes([](int, const auto& p) { return ExactFix(1.5 * p); });
  EXPECT_FALSE(GeoreferenceOf(map, {}));
  EXPECT_THAT(FixesAsPriors(map, {}), IsEmpty());
}

TEST(GeoreferenceMap, TooFewFixesOrTooNearTellNothing) {
  const auto none = MapWithFixes([](int, const auto&) { return std::nullopt; });
  const auto near = MapWithFixes([](int i, const auto& p) {
    return i < 20 ? std::optional(ExactFix(p)) : std::nullopt;  // 38 m
  });
  for (const Map& map : {none, near, Map()}) {
    EXPECT_FALSE(GeoreferenceOf(map, {}));
    EXPECT_THAT(FixesAsPriors(map, {}), IsEmpty());
  }
}

TEST(GeoreferenceMap, PriorsNameThePosesAndLieWhereTheyWereTaken) {
  const Map map = MapWithFixes(
      [](int i, const auto& p) { return i % 2 == 0 ? std::optional(ExactFix(p)) : std::nullopt; });
  const auto priors = FixesAsPriors(map, {});
  ASSERT_THAT(priors, SizeIs(kCount / 2));
  for (const PositionPrior& prior : priors) {
    EXPECT_EQ(prior.pose_idx % 2, 0u);
    const Keyframe& keyframe = *map.Find(KeyframeId{kDrive, prior.pose_idx});
    EXPECT_LT((prior.position_in_map - keyframe.map_from_camera.translation).norm(), 0.01);
  }
}

TEST(GeoreferenceMap, FixesOfOneErrorTogetherWeighAsOne) {
  const Map map = MapWithFixes([](int, const auto& p) { return ExactFix(p); });
  const auto sum = [&](double correlation_s) {
    double weights = 0;
    for (const PositionPrior& prior : FixesAsPriors(map, {.correlation_s = correlation_s}))
      weights += prior.weight;
    return weights;
  };
  EXPECT_NEAR(sum(0), kCount, 1e-9) << "each by itself";
  const double duration_s = 0.2 * kCount;
  EXPECT_NEAR(sum(6), duration_s / 6, 1) << "one in six seconds";
  EXPECT_NEAR(sum(100), 1, 1e-9) << "the drive as a whole";
}

TEST(GeoreferenceMap, ReplacesFixesByWhatAllTell) {
  const Map map = MapWithFixes([](int i, Eigen::Vector3d p) {
    if (i == 50) p += Eigen::Vector3d(45, 0, 0);
    return i == 60 ? std::nullopt : std::optional(ExactFix(p));
  });
  LeanMap lean;
  for (const auto& [id, keyframe] : map.keyframes())
    lean.keyframes.push_back({id, keyframe.timestamp, keyframe.map_from_camera, keyframe.gps});
  ReplaceFixes(GeoreferenceOf(map, {}).value(), lean);
  const LocalEnu enu(kOrigin);
  for (const LeanKeyframe& keyframe : lean.keyframes) {
    ASSERT_TRUE(keyframe.gps);
    const Eigen::Vector3d truth = EnuFromMap() * keyframe.map_from_camera.translation;
    EXPECT_LT((enu.FromGps(*keyframe.gps) - truth).norm(), 0.5) << keyframe.id.index;
  }
}

}  // namespace
}  // namespace carmap
