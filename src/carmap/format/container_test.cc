#include "carmap/format/container.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace carmap {
namespace {

using ::testing::HasSubstr;

const std::vector<Section> kSections = {{1, true, "first"}, {4, false, ""}, {9, true, "third one"}};

std::string MessageOf(std::string_view bytes) {
  const auto sections = ReadContainer(bytes, "a.cmap");
  return sections.ok() ? "accepted" : std::string(sections.status().message());
}

TEST(Container, KeepsSections) {
  const std::string bytes = WriteContainer(kSections);
  const auto read = ReadContainer(bytes, "a.cmap");
  ASSERT_TRUE(read.ok()) << read.status();
  ASSERT_EQ(read->size(), kSections.size());
  for (size_t i = 0; i < kSections.size(); ++i) {
    EXPECT_EQ((*read)[i].id, kSections[i].id);
    EXPECT_EQ((*read)[i].is_mandatory, kSections[i].is_mandatory);
    EXPECT_EQ((*read)[i].content, kSections[i].content);
  }
}

TEST(Container, SaysThatItIsCutShortAndByHowMuch) {
  const std::string bytes = WriteContainer(kSections);
  EXPECT_EQ(MessageOf(std::string_view(bytes).substr(0, bytes.size() - 3)),
            "a.cmap: cut short (" + std::to_string(bytes.size() - 3) + " bytes of " +
                std::to_string(bytes.size()) + "); copy or download the file again");
  EXPECT_THAT(MessageOf(""), HasSubstr("cut short"));
  EXPECT_THAT(MessageOf(std::string_view(bytes).substr(0, 3)), HasSubstr("cut short"));
}

TEST(Container, RefusesWhatFollowsItsEnd) {
  EXPECT_THAT(MessageOf(WriteContainer(kSections) + "x"), HasSubstr("1 bytes follow its end"));
}

TEST(Container, RefusesOtherFiles) {
  EXPECT_EQ(MessageOf("%PDF-1.4"),
            "a.cmap: not a carmap map file; name a .cmap file that carmap wrote");
}

TEST(Container, TellsToUpgradeForANewerVersion) {
  std::string bytes = WriteContainer(kSections);
  bytes[8] = 5;
  bytes[10] = 7;
  const auto read = ReadContainer(bytes, "a.cmap");
  EXPECT_TRUE(absl::IsUnimplemented(read.status()));
  EXPECT_EQ(MessageOf(bytes),
            "a.cmap: format version 5.7 is newer than the supported 4.x; upgrade carmap");
}

TEST(Container, TellsToMapAnewForAnOlderVersion) {
  std::string bytes = WriteContainer(kSections);
  bytes[8] = 1;
  EXPECT_EQ(MessageOf(bytes),
            "a.cmap: format version 1.0 is older than the supported 4.x; map its drive again");
}

TEST(Container, RefusesSectionsOutOfOrderOrTwice) {
  EXPECT_THAT(MessageOf(WriteContainer({{2, true, "b"}, {1, true, "a"}})), HasSubstr("order"));
  EXPECT_THAT(MessageOf(WriteContainer({{2, true, "b"}, {2, true, "a"}})), HasSubstr("order"));
}

TEST(Container, RefusesEachCutAndEachFlippedBit) {
  const std::string bytes = WriteContainer(kSections);
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(ReadContainer(std::string_view(bytes).substr(0, size), "a.cmap").ok()) << size;
  }
  for (size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    std::string damaged = bytes;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    EXPECT_FALSE(ReadContainer(damaged, "a.cmap").ok()) << bit;
  }
}

}  // namespace
}  // namespace carmap
