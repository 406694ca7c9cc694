#include "apps/carmap/segmenter_option.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>

namespace carmap {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

TEST(SegmenterOptionTest, IsNoneUnlessGiven) {
  std::string segmenter;
  CLI::App app;
  AddSegmenterOption(app, segmenter);
  app.parse("");
  EXPECT_EQ(segmenter, "none");
  app.parse("--segmenter net.onnx");
  EXPECT_EQ(segmenter, "net.onnx");
  EXPECT_THAT(app.help(), HasSubstr("--segmenter none|default|labels|NET.onnx"));
}

TEST(SegmenterOptionTest, NamesTheFilesThatAreRead) {
  EXPECT_THAT(FilesOfSegmenter("none", "d"), IsEmpty());
  EXPECT_THAT(FilesOfSegmenter("labels", "d"), ElementsAre("d/labels"));
  EXPECT_THAT(FilesOfSegmenter("folder", "d"), ElementsAre("folder"));
  EXPECT_THAT(FilesOfSegmenter("a/net.onnx", "d"), ElementsAre("a/net.onnx", "a/net.json"));
  EXPECT_THAT(FilesOfSegmenter("net.json", "d"), ElementsAre("net.json", "net.json"));
}

}  // namespace
}  // namespace carmap
