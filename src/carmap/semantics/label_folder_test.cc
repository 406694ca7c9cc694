#include "carmap/semantics/label_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "carmap/semantics/mobility.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

constexpr int kWidth = 64, kHeight = 32;

class LabelFolderTest : public testing::Test {
 protected:
  LabelFolderTest() : folder_(fs::path(testing::TempDir()) / "carmap_label_test") {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void Write(const std::string& name, const cv::Mat& labels) const {
    cv::imwrite((folder_ / name).string(), labels);
  }
  auto Open() const { return OpenLabelFolder(folder_, {kWidth, kHeight}); }
  std::string OpenError() const {
    const auto opened = Open();
    EXPECT_FALSE(opened.ok());
    EXPECT_THAT(std::string(opened.status().message()), HasSubstr("; "));
    return std::string(opened.status().message());
  }
  static cv::Mat Roads() { return {kHeight, kWidth, CV_8UC1, cv::Scalar(0)}; }

  const fs::path folder_;
};

TEST_F(LabelFolderTest, GivesTheMobilityOfEachPixel) {
  cv::Mat labels = Roads();
  labels.at<uint8_t>(1, 2) = 13;
  labels.at<uint8_t>(31, 63) = 255;
  labels.at<uint8_t>(0, 5) = 18;
  Write("000007.png", labels);
  const auto segmenter = Open();
  ASSERT_TRUE(segmenter.ok()) << segmenter.status();
  const auto mobility = (*segmenter)->Segment({7, cv::Mat()});
  ASSERT_TRUE(mobility.ok()) << mobility.status();
  cv::Mat expected(kHeight, kWidth, CV_8UC1, cv::Scalar(static_cast<double>(Mobility::kStatic)));
  expected.at<uint8_t>(1, 2) = expected.at<uint8_t>(0, 5) =
      static_cast<uint8_t>(Mobility::kNonStatic);
  expected.at<uint8_t>(31, 63) = static_cast<uint8_t>(Mobility::kUnknown);
  EXPECT_EQ(cv::norm(*mobility, expected, cv::NORM_INF), 0);
}

TEST_F(LabelFolderTest, FramesWithoutLabelsAreUnknown) {
  Write("000007.png", Roads());
  const auto mobility = (*Open())->Segment({8, cv::Mat()});
  ASSERT_TRUE(mobility.ok());
  EXPECT_EQ(mobility->size(), cv::Size(kWidth, kHeight));
  EXPECT_EQ(cv::countNonZero(*mobility != static_cast<double>(Mobility::kUnknown)), 0);
}

TEST_F(LabelFolderTest, MustHoldLabels) {
  EXPECT_THAT(OpenError(), HasSubstr("has no labels"));
  for (const char* name : {"7.png", "0000007.png", "abc.png", "000007.jpg"}) {
    Write(name, Roads());
  }
  EXPECT_THAT(OpenError(), HasSubstr("has no labels"));
  fs::remove_all(folder_);
  EXPECT_THAT(OpenError(), HasSubstr("no such folder"));
}

TEST_F(LabelFolderTest, RefusesLabelsOfAnotherImageAtOnce) {
  Write("000001.png", cv::Mat(kHeight, kWidth + 1, CV_8UC1, cv::Scalar(0)));
  EXPECT_THAT(OpenError(),
              AllOf(HasSubstr("000001.png: the labels are 65x32 px"), HasSubstr("images 64x32")));
}

TEST_F(LabelFolderTest, RefusesWhatIsNoClass) {
  Write("000000.png", Roads());
  const auto segmenter = Open();
  ASSERT_TRUE(segmenter.ok()) << segmenter.status();
  const auto error = [&](const cv::Mat& labels) {
    Write("000001.png", labels);
    return std::string((*segmenter)->Segment({1, cv::Mat()}).status().message());
  };
  cv::Mat labels = Roads();
  labels.at<uint8_t>(4, 3) = 19;
  EXPECT_THAT(error(labels), HasSubstr("000001.png: pixel (3, 4) has the label 19"));
  labels.at<uint8_t>(4, 3) = 254;
  EXPECT_THAT(error(labels), HasSubstr("label 254"));
  // Reduced to 8 bits it would all be road.
  EXPECT_THAT(error(cv::Mat(kHeight, kWidth, CV_16UC1, cv::Scalar(13))), HasSubstr("8-bit grey"));
  EXPECT_THAT(error(cv::Mat(kHeight, kWidth, CV_8UC3, cv::Scalar(13, 13, 13))),
              HasSubstr("8-bit grey"));
  std::ofstream(folder_ / "000001.png") << "none";
  EXPECT_THAT(std::string((*segmenter)->Segment({1, cv::Mat()}).status().message()),
              HasSubstr("000001.png: "));
}

}  // namespace
}  // namespace carmap
