#include "carmap/vehicle/new_landmarks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "carmap/map/test_street.h"

namespace carmap {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr DriveId kDrive{2, 2};
constexpr uint32_t kNewFrom = 10'000;

/// Façades along 60 m of which a drive recognises a share, and a thing that it does not know.
struct Scene {
  LeanMap base, drive;
  std::vector<SameLandmark> seen_again;

  explicit Scene(double recognised, size_t of_new_thing) {
    StreetRandom random(4);
    base.drives = {{{1, 1}, kStreetRig}};
    drive.drives = {{kDrive, kStreetRig}};
    for (uint32_t i = 0; i < 30; ++i) {
      const Rigid3 pose{Eigen::Quaterniond::Identity(), {0, 0, 2.0 * i}};
      base.keyframes.push_back({{{1, 1}, i}, {}, pose, {}});
      drive.keyframes.push_back({{kDrive, i}, {}, pose, {}});
    }
    for (uint32_t i = 0; i < 600; ++i) {
      const double z = 0.1 * i;
      const uint32_t viewer = std::min(29u, static_cast<uint32_t>(z / 2));
      const Eigen::Vector3d place(random.Bits() % 2 ? 8 : -8, random.Uniform(-3, 1), z + 6);
      Add(base, {{1, 1}, i}, place, viewer);
      const bool is_known = random.Uniform(0, 1) < recognised;
      Add(drive, {kDrive, i},
          is_known ? place : place + Eigen::Vector3d(0, random.Uniform(0.2, 0.8), 0.15), viewer);
      if (is_known) seen_again.push_back({{{1, 1}, i}, {kDrive, i}});
    }
    for (uint32_t i = 0; i < of_new_thing; ++i) {
      Add(drive, {kDrive, kNewFrom + i},
          {random.Uniform(3, 4), random.Uniform(-2, 1), random.Uniform(30, 33)}, 12);
    }
  }
  static void Add(LeanMap& map, LandmarkId id, const Eigen::Vector3d& place, uint32_t viewer) {
    LeanLandmark& landmark = map.landmarks.emplace_back();
    landmark.id = id;
    landmark.position_in_map = place;
    landmark.keyframe_idxs = {viewer};
    landmark.anchor_idx = viewer;
  }
  /// Those that are of the new thing, and the others.
  std::pair<size_t, size_t> Find() const {
    std::set<LandmarkId> seen;
    for (const SameLandmark& same : seen_again) seen.insert(same.in_base);
    const auto is_seen = [&](LandmarkId id) { return seen.contains(id); };
    size_t of_thing = 0, others = 0;
    for (const uint32_t i : NewLandmarks(Reconstruct(base), drive, seen_again, is_seen)) {
      (drive.landmarks[i].id.index >= kNewFrom ? of_thing : others) += 1;
    }
    return {of_thing, others};
  }
};

TEST(NewLandmarks, OtherCornersOfKnownThingsAreNone) {
  for (const double recognised : {0.9, 0.6, 0.3}) {
    SCOPED_TRACE(recognised);
    EXPECT_LT(Scene(recognised, 0).Find().second, 600 * 0.03);
  }
}

TEST(NewLandmarks, AreThoseOfAThingThatIsNotKnown) {
  for (const double recognised : {0.9, 0.6}) {
    SCOPED_TRACE(recognised);
    const auto [of_thing, others] = Scene(recognised, 20).Find();
    EXPECT_GE(of_thing, 18u);
    EXPECT_LT(others, 600 * 0.03);
  }
}

TEST(NewLandmarks, AreAShareOfTheStretchAtMost) {
  const auto [of_thing, others] = Scene(0.9, 300).Find();
  EXPECT_LE(of_thing + others, static_cast<size_t>(900 * NewLandmarkOptions().max_share));
}

TEST(NewLandmarks, OfNothingAreNone) {
  const Scene scene(0.5, 0);
  EXPECT_THAT(NewLandmarks(Reconstruct(scene.base), {}, {}, [](LandmarkId) { return false; }),
              IsEmpty());
}

}  // namespace
}  // namespace carmap
