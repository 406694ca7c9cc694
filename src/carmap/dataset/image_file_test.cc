#include "carmap/dataset/image_file.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "carmap/base/file.h"

namespace carmap {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr int kWidth = 96, kHeight = 64;

/// Smooth, so that JPEG keeps it.
cv::Mat Picture() {
  cv::Mat image(kHeight, kWidth, CV_8UC1);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) image.at<uint8_t>(y, x) = static_cast<uint8_t>(x + 2 * y);
  }
  return image;
}

cv::Mat Colour() {
  cv::Mat colour;
  cv::merge(std::vector<cv::Mat>(3, Picture()), colour);
  return colour;
}

std::string Encoded(const std::string& extension, const cv::Mat& image,
                    const std::vector<int>& parameters = {}) {
  std::vector<uint8_t> bytes;
  cv::imencode(extension, image, bytes, parameters);
  return {bytes.begin(), bytes.end()};
}

class ImageFileTest : public testing::Test {
 protected:
  ImageFileTest() : folder_(fs::path(testing::TempDir()) / "carmap_image_test") {
    fs::create_directories(folder_);
  }
  fs::path Write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }
  void ExpectPicture(const std::string& name, const std::string& bytes, double tolerance = 0) {
    EXPECT_TRUE(HasImageExtension(name)) << name;
    const auto image = ReadGreyImage(Write(name, bytes));
    ASSERT_TRUE(image.ok()) << image.status();
    ASSERT_EQ(image->type(), CV_8UC1) << name;
    EXPECT_LE(cv::norm(*image, Picture(), cv::NORM_INF), tolerance) << name;
  }
  const fs::path folder_;
};

TEST_F(ImageFileTest, ReadsEachFormatWhateverTheCaseOfItsExtension) {
  for (const char* extension : {".png", ".pgm", ".bmp", ".tif", ".tiff"}) {
    ExpectPicture(fmt::format("a{}", extension), Encoded(extension, Picture()));
  }
  for (const char* extension : {".png", ".bmp", ".tif"}) {
    ExpectPicture(fmt::format("colour{}", extension), Encoded(extension, Colour()), 1);
  }
  for (const char* name : {"a.PNG", "a.Tif", "a.TIFF", "a.BMP", "a.PGM"}) {
    ExpectPicture(name, Encoded(".png", Picture()));
  }
  for (const char* name : {"a.JPG", "a.jpeg", "a.Jpeg"}) {
    ExpectPicture(name, Encoded(".jpg", Picture()), 6);
  }
  EXPECT_FALSE(HasImageExtension("a.gif"));
  EXPECT_FALSE(HasImageExtension("png"));
}

TEST_F(ImageFileTest, ReadsJpegUpToItsEndAndNoFurther) {
  const std::vector<std::vector<int>> kinds = {
      {}, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}, {cv::IMWRITE_JPEG_RST_INTERVAL, 2}};
  for (const std::vector<int>& parameters : kinds) {
    const std::string bytes = Encoded(".jpg", Picture(), parameters);
    for (const std::string& after : {std::string("\0\0\0", 3), std::string("\n"), bytes}) {
      ExpectPicture("a.jpg", bytes + after, 6);
    }
    const auto image =
        ReadGreyImage(Write("a.jpg", bytes.substr(0, bytes.size() - 2) + std::string(100, '\0')));
    EXPECT_THAT(std::string(image.status().message()), HasSubstr("truncated"));
  }
}

TEST_F(ImageFileTest, RefusesEachFormatCutAnywhere) {
  for (const char* extension : {".jpg", ".pgm", ".bmp", ".tif"}) {
    const std::string bytes = Encoded(extension, Picture());
    for (size_t size = 2; size < bytes.size(); size += 1 + size / 16) {
      EXPECT_FALSE(ReadGreyImage(Write("cut", bytes.substr(0, size))).ok()) << extension << size;
    }
    if (std::string(extension) == ".tif") continue;  // it ends with what no picture needs
    EXPECT_FALSE(ReadGreyImage(Write("cut", bytes.substr(0, bytes.size() - 1))).ok()) << extension;
  }
}

TEST_F(ImageFileTest, BearsEachFormatWithAnyByteChanged) {
  for (const char* extension : {".jpg", ".pgm", ".bmp", ".tif"}) {
    const std::string bytes = Encoded(extension, Picture());
    for (size_t byte = 0; byte < bytes.size(); byte += 1 + byte / 64) {
      for (const char value : {'\0', '\x7f', '\xff'}) {
        std::string changed = bytes;
        changed[byte] = value;
        const auto image = ReadGreyImage(Write("changed", changed));
        EXPECT_TRUE(!image.ok() || image->type() == CV_8UC1);
      }
    }
  }
}

TEST_F(ImageFileTest, ReadsPgmWithComments) {
  std::string pixels(reinterpret_cast<const char*>(Picture().data), kWidth * kHeight);
  ExpectPicture("a.pgm", "P5\n# by a scanner, 7 7\n96 64\n255\n" + pixels);
  ExpectPicture("a.pgm", "P5\n# a\n# b\n96 64\n# 7\n255\n" + pixels);
  EXPECT_FALSE(ReadGreyImage(Write("a.pgm", "P5\n# never ends")).ok());
}

TEST_F(ImageFileTest, ScalesLevelsByTheBitsThatAreUsed) {
  cv::Mat deep;
  for (const int bits : {10, 12, 14, 16}) {
    // The brightest pixel of the picture tells how many bits there are.
    cv::Mat picture = Picture();
    picture.at<uint8_t>(0, 0) = 255;
    picture.convertTo(deep, CV_16U, ((1 << bits) - 1) / 255.0);
    for (const char* extension : {".pgm", ".png", ".tif"}) {
      const fs::path path = Write("deep", Encoded(extension, deep));
      const auto levels = ReadGreyLevels(path);
      ASSERT_TRUE(levels.ok()) << levels.status();
      ASSERT_EQ(levels->type(), CV_16UC1);
      EXPECT_EQ(UsedBits(*levels), bits) << extension;
      EXPECT_LE(cv::norm(ToEightBits(*levels, bits), picture, cv::NORM_INF), 1) << extension;
    }
  }
  EXPECT_EQ(UsedBits(Picture()), 8);
}

}  // namespace
}  // namespace carmap
