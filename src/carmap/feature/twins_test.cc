#include "carmap/feature/twins.h"

#include <gtest/gtest.h>

#include "carmap/feature/test_descriptors.h"

namespace carmap {
namespace {

constexpr PinholeCamera kCamera{500, 500, 320, 120, 640, 240};

class LinkTwinsTest : public testing::Test {
 protected:
  /// A feature whose signature is `bits` bits off `descriptor_` at most.
  void Add(float x_px, float y_px, uint8_t level, int bits) {
    features_.push_back({.x_px = x_px,
                         .y_px = y_px,
                         .level = level,
                         .descriptor = WithFlippedBits(descriptor_, bits, random_)});
  }
  void AddStranger(float x_px, float y_px, uint8_t level) {
    features_.push_back(
        {.x_px = x_px, .y_px = y_px, .level = level, .descriptor = RandomDescriptor(random_)});
  }
  std::vector<uint32_t> Corners() {
    LinkTwins(kCamera, features_);
    std::vector<uint32_t> corners;
    for (uint32_t i = 0; i < features_.size(); ++i) corners.push_back(CornerOf(features_, i));
    return corners;
  }

  std::mt19937_64 random_{5};
  Descriptor descriptor_ = RandomDescriptor(random_);
  std::vector<Feature> features_;
};

TEST_F(LinkTwinsTest, OneCornerAtSeveralLevelsIsOne) {
  Add(100, 50, 0, 0);
  Add(102, 51, 1, 10);
  Add(104, 52, 4, 10);  // beyond 3 px, but not at its level
  EXPECT_EQ(Corners(), (std::vector<uint32_t>{0, 0, 0}));
}

TEST_F(LinkTwinsTest, OtherCornersStayApart) {
  Add(100, 50, 0, 0);
  Add(102, 51, 0, 5);       // as fine: found beside it
  Add(104, 50, 1, 0);       // too far from the first
  AddStranger(101, 50, 2);  // looks different
  Add(300, 50, 7, 0);       // the same texture elsewhere
  EXPECT_EQ(Corners(), (std::vector<uint32_t>{0, 1, 1, 3, 4}));
}

TEST_F(LinkTwinsTest, GoesToTheOneThatItResemblesMost) {
  Add(100, 50, 0, 25);
  Add(102, 50, 0, 0);
  Add(101, 50, 1, 3);
  EXPECT_EQ(Corners(), (std::vector<uint32_t>{0, 1, 1}));
}

}  // namespace
}  // namespace carmap
