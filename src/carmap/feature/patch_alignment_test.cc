#include "carmap/feature/patch_alignment.h"

#include <map>

#include "carmap/feature/test_images.h"
#include "carmap/feature/test_processors.h"

namespace carmap {
namespace {

constexpr int kWidth = 200, kHeight = 80;

class AlignPatchTest : public OnEachProcessor {};
INSTANTIATE_TEST_SUITE_P(Processors, AlignPatchTest, kProcessors, NameOfProcessor);

TEST_P(AlignPatchTest, FindsFractionsOfAPixelOnBothAxes) {
  const Wall wall(kWidth, kHeight, 1);
  const cv::Mat left = wall.Moved(0), right = wall.Moved(5 * 12 + 2, -3) + cv::Scalar(6);
  for (int x = 40; x < 180; x += 10) {
    const auto place = AlignPatch(left, x, 40, right, {x - 12, 40}, 1.2);
    ASSERT_TRUE(place) << x;
    EXPECT_NEAR(place->x(), x - 12.4, 0.1) << x;
    EXPECT_NEAR(place->y(), 40 - 0.6, 0.1) << x;
  }
}

// Maps must not depend on who made them.
TEST_P(AlignPatchTest, EveryProcessorFindsTheSameToTheLastBit) {
  const Wall wall(kWidth, kHeight, 2);
  const cv::Mat left = wall.Moved(0), right = WithNoise(wall.Moved(5 * 12 + 1, 2), 3, 1);
  std::vector<std::optional<Eigen::Vector2d>> places;
  for (int x = 30; x < 180; ++x) {
    places.push_back(AlignPatch(left, x, 40, right, {x - 12, 40}, 1.2));
  }
  static const auto first_places = places;  // of the first processor
  EXPECT_EQ(places, first_places);
}

TEST_P(AlignPatchTest, StaysInsideTheImages) {
  const cv::Mat left = RandomPixels(kWidth, kHeight, 1), right = RandomPixels(kWidth, kHeight, 1);
  size_t aligned = 0, refused = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      if (!CanAlign(left, x, y)) continue;
      const bool is_found = AlignPatch(left, x, y, right, {x, y}, 1.2).has_value();
      ++(is_found ? aligned : refused);
      for (const double far_px : {-1e3, 1e3}) {
        EXPECT_FALSE(AlignPatch(left, x, y, right, {x + far_px, y}, 1.2));
        EXPECT_FALSE(AlignPatch(left, x, y, right, {x, y + far_px}, 1.2));
      }
    }
  }
  EXPECT_GT(aligned, 1000u);
  EXPECT_FALSE(CanAlign(left, 5, 40));
  EXPECT_FALSE(CanAlign(left, kWidth - kAlignmentRightPx, 40));
  EXPECT_FALSE(CanAlign(left, 40, 5));
  EXPECT_FALSE(CanAlign(left, 40, kHeight - 6));
}

}  // namespace
}  // namespace carmap
