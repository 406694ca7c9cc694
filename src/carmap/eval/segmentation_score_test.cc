#include "carmap/eval/segmentation_score.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

namespace carmap {
namespace {

constexpr auto kStatic = Mobility::kStatic, kNonStatic = Mobility::kNonStatic,
               kUnknown = Mobility::kUnknown;

/// 70 of 80 static and 15 of 20 non-static ones are told rightly.
MobilityConfusion Example() {
  MobilityConfusion confusion;
  confusion.Add(kStatic, kStatic, 70);
  confusion.Add(kStatic, kNonStatic, 6);
  confusion.Add(kStatic, kUnknown, 4);
  confusion.Add(kNonStatic, kNonStatic, 15);
  confusion.Add(kNonStatic, kStatic, 2);
  confusion.Add(kNonStatic, kUnknown, 3);
  confusion.Add(kUnknown, kStatic, 1000);
  confusion.Add(kUnknown, kNonStatic, 1000);
  return confusion;
}

TEST(MobilityConfusionTest, CountsWhatIsKnownToBeTrue) {
  const MobilityConfusion confusion = Example();
  EXPECT_EQ(confusion.count(kStatic), 80u);
  EXPECT_EQ(confusion.count(kNonStatic), 20u);
  EXPECT_DOUBLE_EQ(confusion.Accuracy(), 0.85);
  EXPECT_DOUBLE_EQ(confusion.Iou(kStatic), 70.0 / (80 + 2));
  EXPECT_DOUBLE_EQ(confusion.Iou(kNonStatic), 15.0 / (20 + 6));
  EXPECT_DOUBLE_EQ(confusion.Share(kNonStatic, kNonStatic), 0.75);
  EXPECT_DOUBLE_EQ(confusion.Share(kStatic, kNonStatic), 0.075);
}

TEST(MobilityConfusionTest, OfNothingThereIsNoShare) {
  MobilityConfusion confusion;
  confusion.Add(kStatic, kStatic);
  EXPECT_EQ(confusion.Accuracy(), 1);
  EXPECT_TRUE(std::isnan(confusion.Share(kNonStatic, kNonStatic)));
  EXPECT_TRUE(std::isnan(confusion.Iou(kNonStatic)));
  EXPECT_TRUE(std::isnan(MobilityConfusion().Accuracy()));
}

TEST(SegmentationScoreTest, ComparesLabelsOfAnySizePixelByPixel) {
  // Non-static are columns 4 to 7 of eight; told are, at half the size, columns 1 and 2 of four.
  cv::Mat truth(6, 8, CV_8UC1, cv::Scalar(1)), told(3, 4, CV_8UC1, cv::Scalar(1));
  truth.colRange(4, 8).setTo(2);
  told.colRange(1, 3).setTo(2);
  truth.row(0).setTo(0);
  SegmentationScore score;
  score.TakePixels(truth, AtImageSize(told, truth.size()));
  EXPECT_EQ(score.pixels.count(kStatic, kStatic), 10u);
  EXPECT_EQ(score.pixels.count(kStatic, kNonStatic), 10u);
  EXPECT_EQ(score.pixels.count(kNonStatic, kNonStatic), 10u);
  EXPECT_EQ(score.pixels.count(kNonStatic, kStatic), 10u);
}

TEST(SegmentationScoreTest, IsReported) {
  SegmentationScore score;
  score.pixels = Example();
  score.TakeFeatures({kStatic, kNonStatic, kNonStatic, kUnknown},
                     {kNonStatic, kNonStatic, kStatic, kStatic});
  score.frame_ms = {10, 30};
  const nlohmann::ordered_json json = ToJson(score);
  EXPECT_EQ(json["frames"], 2);
  EXPECT_EQ(json["pixels"]["accuracy"], 0.85);
  EXPECT_EQ(json["features"]["static"], 1);
  EXPECT_EQ(json["features"]["non_static"], 2);
  EXPECT_EQ(json["features"]["non_static_found"], 0.5);
  EXPECT_EQ(json["features"]["static_called_non_static"], 1);
  EXPECT_EQ(json["frame_ms"]["mean"], 20);
  EXPECT_EQ(json["frames_per_second"], 50);
  EXPECT_TRUE(ToJson(SegmentationScore())["pixels"]["accuracy"].is_null());
  EXPECT_TRUE(ToJson(SegmentationScore())["frames_per_second"].is_null());
  EXPECT_THAT(ToText({{"net.onnx", score}}),
              testing::ContainsRegex("net.onnx +85.0 +85.4 +57.7 +33.3 +50.0 +100.0 +20 +50.0"));
}

}  // namespace
}  // namespace carmap
