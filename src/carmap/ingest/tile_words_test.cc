#include "carmap/ingest/tile_words.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "carmap/feature/default_vocabulary.h"

namespace carmap {
namespace {

using ::testing::ElementsAre;

TEST(TileWords, ComeBackFromTheirBytes) {
  const std::vector<uint32_t> words = {0, 1, 5, 300, 301, 70'000, 4'000'000'000};
  const std::string bytes = EncodeWords(words);
  EXPECT_LE(bytes.size(), 14u);
  EXPECT_EQ(*DecodeWords(bytes), words);
  EXPECT_TRUE(DecodeWords("")->empty());
  EXPECT_TRUE(absl::IsDataLoss(DecodeWords("\xff\xff").status()));
  EXPECT_TRUE(absl::IsDataLoss(DecodeWords("\xff\xff\xff\xff\xff\x7f").status()));
}

TEST(TileWords, CountSharedOnesByWeight) {
  const Vocabulary& vocabulary = DefaultVocabulary();
  EXPECT_DOUBLE_EQ(ShareOfWords(vocabulary, {1, 2, 3}, {1, 2, 3, 4, 5}), 1);
  EXPECT_DOUBLE_EQ(ShareOfWords(vocabulary, {1, 2, 3}, {4, 5}), 0);
  EXPECT_DOUBLE_EQ(ShareOfWords(vocabulary, {}, {4, 5}), 0);
  const double one = ShareOfWords(vocabulary, {1, 2}, {1}),
               other = ShareOfWords(vocabulary, {1, 2}, {2});
  EXPECT_NEAR(one + other, 1, 1e-9);
}

}  // namespace
}  // namespace carmap
