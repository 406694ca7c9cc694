#include "carmap/feature/default_vocabulary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "carmap/feature/test_descriptors.h"
#include "carmap/feature/vocabulary_file.h"

namespace carmap {
namespace {

TEST(DefaultVocabulary, IsLargeEnoughToTellPlacesApartAndSmallEnoughToShip) {
  const Vocabulary& vocabulary = DefaultVocabulary();
  EXPECT_GE(vocabulary.word_count(), 5000u);
  EXPECT_LE(EncodeVocabulary(vocabulary).size(), 1'000'000u);
  EXPECT_GE(vocabulary.tables().training_images, 200u);
  EXPECT_EQ(&DefaultVocabulary(), &vocabulary);
}

TEST(DefaultVocabulary, SpreadsDescriptorsOverItsWords) {
  const Vocabulary& vocabulary = DefaultVocabulary();
  std::mt19937_64 random(1);
  std::vector<int> met(vocabulary.word_count(), 0);
  size_t same = 0;
  for (const Descriptor& center : vocabulary.tables().centers) {
    const uint32_t word = vocabulary.WordOf(center);
    ++met[word];
    same += vocabulary.WordOf(WithFlippedBits(center, 5, random)) == word;
  }
  EXPECT_LT(std::count(met.begin(), met.end(), 0), vocabulary.word_count() / 10);
  EXPECT_GT(same, vocabulary.tables().centers.size() * 8 / 10);
}

}  // namespace
}  // namespace carmap
