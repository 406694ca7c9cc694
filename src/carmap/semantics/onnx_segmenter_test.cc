#include "carmap/semantics/onnx_segmenter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <string>

#include "carmap/dataset/image_file.h"
#include "carmap/semantics/mobility.h"
#include "carmap/semantics/test_network.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

constexpr int kWidth = 64, kHeight = 32;

uint8_t Value(Mobility mobility) { return static_cast<uint8_t>(mobility); }

class OnnxSegmenterTest : public testing::Test {
 protected:
  OnnxSegmenterTest() : folder_(fs::path(testing::TempDir()) / "carmap_onnx_test") {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void Write(const std::string& onnx, const Json& json) const {
    std::ofstream(folder_ / "net.onnx", std::ios::binary) << onnx;
    std::ofstream(folder_ / "net.json", std::ios::binary) << json.dump();
  }
  auto Load() const { return LoadOnnxSegmenter(folder_ / "net.onnx", {kWidth, kHeight}); }
  std::string LoadError() const {
    const auto loaded = Load();
    EXPECT_FALSE(loaded.ok());
    const std::string message(loaded.status().message());
    EXPECT_THAT(message, AllOf(HasSubstr("net.onnx: "), HasSubstr("; ")));
    EXPECT_EQ(message.find('\n'), std::string::npos);
    return message;
  }

  const fs::path folder_;
  /// Dark is static, bright non-static, of grey levels about 100 unlabelled.
  const TestNetwork network_{.channels = 1, .weights = {-1, 1, 0}, .biases = {0, 0, 20}};
  const Json json_ = {{"input",
                       {{"channels", "grey"},
                        {"mean", {100}},
                        {"scale", {1}},
                        {"multiple_of", 16},
                        {"max_width", 64}}},
                      {"classes", {"static", "car", "unlabelled"}}};
};

TEST_F(OnnxSegmenterTest, TakesTheClassOfTheHighestScore) {
  Write(network_.Onnx(), json_);
  const auto segmenter = Load();
  ASSERT_TRUE(segmenter.ok()) << segmenter.status();
  cv::Mat image(kHeight, kWidth, CV_8UC1, cv::Scalar(79));
  image.at<uint8_t>(3, 5) = 121;
  image.at<uint8_t>(4, 5) = 119;
  image.at<uint8_t>(31, 63) = 81;
  const auto mobility = (*segmenter)->Segment({0, image});
  ASSERT_TRUE(mobility.ok()) << mobility.status();
  ASSERT_EQ(mobility->size(), image.size());
  ASSERT_EQ(mobility->type(), CV_8UC1);
  EXPECT_EQ(mobility->at<uint8_t>(3, 5), Value(Mobility::kNonStatic));
  EXPECT_EQ(mobility->at<uint8_t>(4, 5), Value(Mobility::kUnknown));
  EXPECT_EQ(mobility->at<uint8_t>(31, 63), Value(Mobility::kUnknown));
  EXPECT_EQ(cv::countNonZero(*mobility == Value(Mobility::kStatic)), kWidth * kHeight - 3);
}

TEST_F(OnnxSegmenterTest, NormalizesEachChannel) {
  // Sum of (level - mean) * scale: (50 - 10) * 1 + (50 - 20) * 2 - (50 - 30) * 3 = 40.
  const TestNetwork sum{.channels = 3, .weights = {1, 1, -1, 0, 0, 0}, .biases = {0, 39}};
  Json json = json_;
  json["input"]["channels"] = "rgb";
  json["input"]["mean"] = {10, 20, 30};
  json["input"]["scale"] = {1, 2, 3};
  json["classes"] = {"car", "road"};
  Write(sum.Onnx(), json);
  const cv::Mat image(kHeight, kWidth, CV_8UC1, cv::Scalar(50));
  EXPECT_EQ((*Load())->Segment({0, image})->at<uint8_t>(0, 0), Value(Mobility::kNonStatic));
  json["input"]["scale"] = {1, 2, 3.1};
  Write(sum.Onnx(), json);
  EXPECT_EQ((*Load())->Segment({0, image})->at<uint8_t>(0, 0), Value(Mobility::kStatic));
}

TEST_F(OnnxSegmenterTest, ShowsTheWholeImageAtItsOwnSize) {
  Write(network_.Onnx(), json_);
  const auto segmenter = Load();
  cv::Mat image(160, 320, CV_8UC1, cv::Scalar(0));
  image(cv::Rect(160, 80, 160, 80)).setTo(255);
  const auto mobility = (*segmenter)->Segment({0, image});
  ASSERT_EQ(mobility->size(), cv::Size(64, 32));
  cv::Mat expected(32, 64, CV_8UC1, cv::Scalar(Value(Mobility::kStatic)));
  expected(cv::Rect(32, 16, 32, 16)).setTo(Value(Mobility::kNonStatic));
  EXPECT_TRUE(HaveSamePixels(*mobility, expected));
}

TEST_F(OnnxSegmenterTest, SaysWhichFileIsMissing) {
  EXPECT_THAT(std::string(Load().status().message()), HasSubstr("net.json: no such file"));
  Write("", json_);
  fs::remove(folder_ / "net.onnx");
  EXPECT_THAT(LoadError(), HasSubstr("no such file"));
}

TEST_F(OnnxSegmenterTest, RefusesWhatIsNoNetwork) {
  const std::string onnx = network_.Onnx();
  for (const std::string& bytes : {std::string(), std::string("no network"), onnx.substr(0, 100),
                                   onnx.substr(0, onnx.size() - 20), std::string(5000, '\xff')}) {
    Write(bytes, json_);
    EXPECT_THAT(LoadError(), HasSubstr("network"));
  }
}

TEST_F(OnnxSegmenterTest, SurvivesTruncatedNetworks) {
  const std::string onnx = network_.Onnx();
  for (size_t length = 0; length < onnx.size(); ++length) {
    SCOPED_TRACE(length);
    Write(onnx.substr(0, length), json_);
    LoadError();
  }
}

TEST_F(OnnxSegmenterTest, RefusesNetworksThatAreNotAsDescribed) {
  Json json = json_;
  json["classes"] = {"road", "car"};
  Write(network_.Onnx(), json);
  EXPECT_THAT(LoadError(),
              HasSubstr("its output has 3 channels, and its JSON file names 2 classes"));

  json["input"]["channels"] = "rgb";
  json["input"]["mean"] = json["input"]["scale"] = {1, 1, 1};
  Write(TestNetwork{.channels = 1, .weights = {-1, 1}, .biases = {0, 0}}.Onnx(), json);
  EXPECT_THAT(LoadError(), HasSubstr("fails on an input of 1x3x32x64"));

  json = json_;
  json["input"]["name"] = "picture";
  Write(network_.Onnx(), json);
  EXPECT_THAT(LoadError(), HasSubstr("picture"));

  TestNetwork other = network_;
  other.is_flat = true;
  Write(other.Onnx(), json_);
  EXPECT_THAT(LoadError(), HasSubstr("its output has 2 dimensions"));

  other = network_;
  other.has_two_outputs = true;
  Write(other.Onnx(), json_);
  EXPECT_THAT(LoadError(), HasSubstr("has 2 outputs"));
}

TEST_F(OnnxSegmenterTest, ScoresMustBeFinite) {
  TestNetwork broken = network_;
  broken.biases[1] = std::numeric_limits<float>::quiet_NaN();
  Write(broken.Onnx(), json_);
  EXPECT_THAT(LoadError(), HasSubstr("not finite"));

  // Finite for the blank image of the trial alone: 0 * 3e38 * 3e38.
  Json json = json_;
  json["input"]["mean"] = {0};
  broken = network_;
  broken.weights[0] = 3e38f;
  Write(broken.Onnx(), json);
  const auto segmenter = Load();
  ASSERT_TRUE(segmenter.ok()) << segmenter.status();
  const cv::Mat image(kHeight, kWidth, CV_8UC1, cv::Scalar(255));
  const auto mobility = (*segmenter)->Segment({0, image});
  EXPECT_THAT(std::string(mobility.status().message()),
              AllOf(HasSubstr("net.onnx: "), HasSubstr("not finite")));
}

/// A network of the wide world on a street with parked cars.
class RealNetworkTest : public OnnxSegmenterTest {
 protected:
  void SetUp() override {
    const char* const from_environment = std::getenv("CARMAP_DATA");
    frame_ = fs::path(from_environment ? from_environment : CARMAP_DATA_DIR) /
             "kitti06_000-050/image_0/000000.png";
    network_path_ = fs::path(CARMAP_MODELS_DIR) / "espnetv2_s2.0_city_832x256_rgb255.onnx";
    for (const fs::path& path : {frame_, network_path_}) {
      if (!fs::exists(path)) GTEST_SKIP() << path << " is absent";
    }
    json_of_network_ = {
        {"model", network_path_.string()},
        {"input",
         {{"channels", "rgb"},
          {"mean", {0, 0, 0}},
          {"scale", {1, 1, 1}},
          {"width", 832},
          {"height", 256}}},
        {"classes", {"road", "sidewalk",      "building",     "wall",       "fence",
                     "pole", "traffic light", "traffic sign", "vegetation", "terrain",
                     "sky",  "person",        "rider",        "car",        "truck",
                     "bus",  "train",         "motorcycle",   "bicycle",    "unlabelled"}}};
  }
  fs::path frame_, network_path_;
  Json json_of_network_;
};

TEST_F(RealNetworkTest, FindsParkedCars) {
  Write("", json_of_network_);
  const auto image = ReadGreyImage(frame_);
  ASSERT_TRUE(image.ok()) << image.status();
  const auto segmenter = LoadOnnxSegmenter(folder_ / "net.json", image->size());
  ASSERT_TRUE(segmenter.ok()) << segmenter.status();
  const auto mobility = (*segmenter)->Segment({0, *image});
  ASSERT_TRUE(mobility.ok()) << mobility.status();
  EXPECT_EQ(mobility->size(), cv::Size(416, 128));
  // In pixels of the image, which the network sees at 832x256 and tells at half of that.
  const auto share = [&](int left, int top, int right, int bottom) {
    const cv::Rect part(cv::Point(left * 416 / image->cols, top * 128 / image->rows),
                        cv::Point(right * 416 / image->cols, bottom * 128 / image->rows));
    return cv::mean((*mobility)(part) == Value(Mobility::kNonStatic))[0] / 255;
  };
  EXPECT_GT(share(725, 180, 835, 235), 0.95) << "the near car";
  EXPECT_GT(share(650, 178, 680, 198), 0.7) << "the far car";
  EXPECT_LT(share(450, 260, 700, 370), 0.01) << "road";
  EXPECT_LT(share(860, 50, 1000, 150), 0.02) << "house";
}

}  // namespace
}  // namespace carmap
