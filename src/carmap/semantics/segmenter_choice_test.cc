#include "carmap/semantics/segmenter_choice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "carmap/semantics/mobility.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

TEST(SegmenterChoiceTest, FollowsTheUsersWord) {
  const fs::path drive = fs::path(testing::TempDir()) / "carmap_choice_test";
  fs::remove_all(drive);
  const auto error = [&](const std::string& choice) {
    return std::string(MakeSegmenter(choice, drive, {64, 32}).status().message());
  };
  EXPECT_THAT(error("labels"), HasSubstr((drive / "labels").string() + ": no such folder"));
  fs::create_directories(drive / "labels");
  cv::imwrite((drive / "labels/000000.png").string(), cv::Mat(32, 64, CV_8UC1, cv::Scalar(13)));

  EXPECT_EQ(*MakeSegmenter("none", drive, {64, 32}), nullptr);
  for (const std::string& choice : {std::string("labels"), (drive / "labels").string()}) {
    const auto segmenter = MakeSegmenter(choice, drive, {64, 32});
    ASSERT_TRUE(segmenter.ok()) << segmenter.status();
    EXPECT_EQ((*segmenter)->Segment({0, cv::Mat()})->at<uint8_t>(31, 63),
              static_cast<uint8_t>(Mobility::kNonStatic));
  }
  EXPECT_THAT(error("absent.onnx"), HasSubstr("absent.json: no such file"));
  EXPECT_THAT(error("absent.json"), HasSubstr("absent.json: no such file"));
  EXPECT_THAT(error("label"), HasSubstr("label: is no segmenter; give none, default, labels"));
  EXPECT_THAT(error(""), HasSubstr("is no segmenter"));
}

}  // namespace
}  // namespace carmap
