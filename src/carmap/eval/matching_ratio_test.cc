#include "carmap/eval/matching_ratio.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "carmap/feature/default_vocabulary.h"
#include "carmap/map/test_street.h"

namespace carmap {
namespace {

const Rigid3 kMapFromWorld{RotationExp({0.1, -0.7, 0.05}), {3, -1, 20}};

class MatchingMeterTest : public ::testing::Test {
 protected:
  MatchingMeterTest()
      : map_(
            Reconstruct(MapStreet(street_, {5}, kStreetRig, DriveAlong(0, 0, 110), kMapFromWorld))),
        meter_(map_, kStreetRig, DefaultVocabulary()) {}

  MatchingCounts Measure(const std::vector<Feature>& features) const {
    return meter_.Measure(features, (kMapFromWorld * pose_).Inverse(), 1);
  }

  const Street street_ = MakeStreet(3, 160);
  const Rigid3 pose_ = DriveAlong(0, 50, 50).front();
  const ReconstructedMap map_;
  const MatchingMeter meter_;
};

TEST_F(MatchingMeterTest, CountsNearlyAllOfAPerfectFrame) {
  const MatchingCounts counts = Measure(SeeStreet(street_, kStreetRig, pose_));
  EXPECT_GT(counts.in_sight, 200u);
  EXPECT_GE(counts.by_position, 0.95 * counts.in_sight);
  EXPECT_GE(counts.by_appearance, 0.5 * counts.in_sight) << "of keyframes that resemble it";
  EXPECT_LE(counts.by_position, counts.in_sight);
}

TEST_F(MatchingMeterTest, LeavesOutWhatIsHidden) {
  const auto all = SeeStreet(street_, kStreetRig, pose_);
  auto half = all;
  std::erase_if(half, [](const Feature& feature) { return feature.x_px > 600; });
  const MatchingCounts whole = Measure(all), hidden = Measure(half);
  EXPECT_LT(hidden.in_sight, 0.7 * whole.in_sight);
  EXPECT_GE(hidden.by_position, 0.9 * hidden.in_sight) << "the ratio is of what is in sight";
  // Something else stands there, nearer.
  for (Feature& feature : half) feature.disparity_px += 10;
  EXPECT_LT(Measure(half).in_sight, 0.2 * hidden.in_sight);
}

TEST_F(MatchingMeterTest, CountsOnlyRightMatches) {
  // Signatures of other corners: what is matched is wrong, or nothing.
  auto features = SeeStreet(street_, kStreetRig, pose_);
  for (size_t i = 0; i + 1 < features.size(); ++i) {
    std::swap(features[i].descriptor, features[i + 1].descriptor);
  }
  const MatchingCounts counts = Measure(features);
  EXPECT_GT(counts.in_sight, 200u);
  EXPECT_LT(counts.by_position, 0.1 * counts.in_sight);
  EXPECT_LT(counts.by_appearance, 0.1 * counts.in_sight);
  EXPECT_EQ(Measure({}).in_sight, 0u);
}

}  // namespace
}  // namespace carmap
