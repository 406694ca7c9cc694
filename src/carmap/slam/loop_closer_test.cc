#include "carmap/slam/loop_closer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <memory>

#include "carmap/slam/test_round.h"

namespace carmap {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kRoundM = 240;
constexpr uint32_t kStepsARound = 160;
constexpr GpsFix kOrigin{49, 8.4, 110};

/// Two rounds with a loop closer, or without one.
struct Rounds {
  Rounds(const Street& street, int steps, bool sequential, bool closes_loops = true)
      : drive(street, {.circumference_m = kRoundM}), closer({.sequential = sequential}, nullptr) {
    for (int i = 0; i < steps; ++i) Step(closes_loops);
    if (closes_loops) closer.Finish(drive.mapper());
  }
  void Step(bool closes_loops) {
    const auto id = drive.Step();
    ASSERT_TRUE(id);
    if (closes_loops && closer.Process(*id, drive.mapper())) drive.Follow(*id);
    ASSERT_TRUE(CheckConsistency(drive.map()).ok()) << CheckConsistency(drive.map());
  }
  /// Worst error between a keyframe and one near by that is a round older.
  double WorstGap() const {
    double worst = 0;
    for (const auto& [id, keyframe] : drive.map().keyframes()) {
      if (id.index < kStepsARound) continue;
      const KeyframeId then{id.drive, id.index - kStepsARound};
      const KeyframeId place = drive.map().keyframes().lower_bound(then)->first;
      worst = std::max(worst, drive.ErrorBetween(place, id));
    }
    return worst;
  }
  RoundDrive drive;
  LoopCloser closer;
};

const Street& RoundStreet() {
  static const Street street = MakeRoundStreet(3, kRoundM);
  return street;
}

TEST(LoopCloser, TakesDriftAwayAndKeepsToTheOldMap) {
  const Rounds with(RoundStreet(), 200, /*sequential=*/true);
  const Rounds without(RoundStreet(), 200, /*sequential=*/true, /*closes_loops=*/false);
  EXPECT_THAT(with.closer.loops(), SizeIs(1)) << "once closed, the vehicle stays in the old map";
  EXPECT_LT(with.WorstGap(), without.WorstGap() / 4);
  EXPECT_LT(with.drive.map().landmarks().size(), without.drive.map().landmarks().size() * 9 / 10);
}

TEST(LoopCloser, ThreadsDoNotChangeTheMap) {
  const Rounds sequential(RoundStreet(), 190, true), threaded(RoundStreet(), 190, false);
  ASSERT_THAT(sequential.closer.loops(), SizeIs(1));
  const Map &a = sequential.drive.map(), &b = threaded.drive.map();
  ASSERT_EQ(a.landmarks().size(), b.landmarks().size());
  for (const auto& [id, landmark] : a.landmarks()) {
    ASSERT_EQ(landmark.position_in_map, b.Find(id)->position_in_map);
    ASSERT_EQ(landmark.observations, b.Find(id)->observations);
  }
  for (const auto& [id, keyframe] : a.keyframes()) {
    ASSERT_EQ(keyframe.map_from_camera.translation, b.Find(id)->map_from_camera.translation);
  }
}

TEST(LoopCloser, EndsWhileTheWholeMapIsAdjusted) {
  RoundDrive drive(RoundStreet(), {.circumference_m = kRoundM});
  LoopCloser closer({.sequential = false}, nullptr);
  while (closer.loops().empty()) closer.Process(drive.Step().value(), drive.mapper());
  // Destroyed with the adjustment under way.
}

TEST(LoopCloser, LeavesLoopsOpenIfAsked) {
  RoundDrive drive(RoundStreet(), {.circumference_m = kRoundM});
  LoopCloser closer({.close_loops = false, .sequential = true}, nullptr);
  const Rounds without(RoundStreet(), 190, true, false);
  for (int i = 0; i < 190; ++i) EXPECT_FALSE(closer.Process(drive.Step().value(), drive.mapper()));
  closer.Finish(drive.mapper());
  EXPECT_THAT(closer.loops(), IsEmpty());
  EXPECT_EQ(drive.map().landmarks().size(), without.drive.map().landmarks().size());
}

TEST(LoopCloser, LeavesADriveWithoutLoopsAlone) {
  const Rounds with(RoundStreet(), 60, true), without(RoundStreet(), 60, true, false);
  EXPECT_THAT(with.closer.loops(), IsEmpty());
  EXPECT_FALSE(with.closer.georeference());
  for (const auto& [id, keyframe] : with.drive.map().keyframes()) {
    EXPECT_EQ(keyframe.map_from_camera.translation,
              without.drive.map().Find(id)->map_from_camera.translation);
  }
}

TEST(LoopCloser, FixesPutTheMapOnTheEarthAndWrongOnesDoNotBendIt) {
  // The world's x is taken for east, its z for north.
  const LocalEnu enu(kOrigin);
  const auto in_enu = [](const Eigen::Vector3d& p) {
    return Eigen::Vector3d(p.x(), p.z(), -p.y());
  };
  StreetRandom random(5);
  RoundDrive drive(RoundStreet(), {.circumference_m = kRoundM});
  LoopCloser closer({.sequential = true}, nullptr);
  int count = 0;
  drive.SetFixes([&](const Eigen::Vector3d& p) -> std::optional<GpsFix> {
    Eigen::Vector3d fix = in_enu(p);
    for (int i = 0; i < 3; ++i) fix[i] += random.Normal(1);
    if (count++ % 40 < 8) fix += Eigen::Vector3d(40, -30, 10);
    return enu.ToGps(fix);
  });
  for (int i = 0; i < 180; ++i) {
    const KeyframeId id = drive.Step().value();
    if (closer.Process(id, drive.mapper())) drive.Follow(id);
  }
  closer.Finish(drive.mapper());
  ASSERT_TRUE(closer.georeference());
  const LocalEnu map_enu(closer.georeference()->origin);
  double worst = 0;
  for (const auto& [id, keyframe] : drive.map().keyframes()) {
    const GpsFix place =
        map_enu.ToGps(closer.georeference()->enu_from_map * keyframe.map_from_camera.translation);
    worst =
        std::max(worst, (enu.FromGps(place) - in_enu(drive.Truth(id.index).translation)).norm());
  }
  EXPECT_LT(worst, 1.0);
}

}  // namespace
}  // namespace carmap
