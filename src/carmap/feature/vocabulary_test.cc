#include "carmap/feature/vocabulary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "carmap/feature/test_descriptors.h"
#include "carmap/feature/vocabulary_trainer.h"

namespace carmap {
namespace {

using ::testing::Each;
using ::testing::HasSubstr;

/// Root with nodes 1 to 3; node 1 a leaf, node 2 with 4 and 5, node 3 with 6, 7 and 8.
VocabularyTables SmallTree(uint64_t seed = 1) {
  std::mt19937_64 random(seed);
  VocabularyTables tables{10, {3, 0, 2, 3}, {}, {1, 2, 3, 4, 5, 6}};
  for (int i = 0; i < 8; ++i) tables.centers.push_back(RandomDescriptor(random));
  return tables;
}

TEST(Vocabulary, NumbersTheLeavesLevelByLevel) {
  const auto vocabulary = Vocabulary::Create(SmallTree());
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  EXPECT_EQ(vocabulary->word_count(), 6u);
  EXPECT_EQ(vocabulary->depth(), 2u);
  // Node 1 is word 0, nodes 4 to 8 are words 1 to 5.
  EXPECT_EQ(vocabulary->WordOf(vocabulary->tables().centers[0]), 0u);
  EXPECT_FLOAT_EQ(vocabulary->WeightOf(5), 6.0f / 4096);
}

TEST(Vocabulary, FollowsTheNearestChild) {
  const Vocabulary vocabulary = *Vocabulary::Create(SmallTree());
  const auto& c = vocabulary.tables().centers;
  const auto nearest = [](const Descriptor& d, const std::vector<Descriptor>& among) {
    size_t best = 0;
    for (size_t i = 1; i < among.size(); ++i) {
      if (HammingDistance(d, among[i]) < HammingDistance(d, among[best])) best = i;
    }
    return static_cast<uint32_t>(best);
  };
  std::mt19937_64 random(2);
  std::vector<int> met(6, 0);
  for (int i = 0; i < 2000; ++i) {
    const Descriptor d = RandomDescriptor(random);
    const uint32_t child = nearest(d, {c[0], c[1], c[2]});
    const uint32_t expected = child == 0   ? 0
                              : child == 1 ? 1 + nearest(d, {c[3], c[4]})
                                           : 3 + nearest(d, {c[5], c[6], c[7]});
    ASSERT_EQ(vocabulary.WordOf(d), expected);
    ++met[expected];
  }
  EXPECT_THAT(met, Each(testing::Gt(50)));
}

TEST(Vocabulary, AgreesWithAllLeavesOnAFlatTree) {
  const auto images = DescriptorsOfImages(20, 300, 3);
  const auto vocabulary = TrainVocabulary(images, {.branching = 50, .depth = 1});
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  EXPECT_EQ(vocabulary->word_count(), 50u);
  for (const Descriptor& descriptor : images[7]) {
    const int distance =
        HammingDistance(vocabulary->tables().centers[vocabulary->WordOf(descriptor)], descriptor);
    for (const Descriptor& center : vocabulary->tables().centers) {
      EXPECT_GE(HammingDistance(center, descriptor), distance);
    }
  }
}

TEST(Vocabulary, RefusesTablesThatAreNoTree) {
  const auto expect_refused = [](const std::function<void(VocabularyTables&)>& damage,
                                 const std::string& what) {
    VocabularyTables tables = SmallTree();
    damage(tables);
    const auto vocabulary = Vocabulary::Create(tables);
    ASSERT_FALSE(vocabulary.ok()) << what;
    EXPECT_EQ(vocabulary.status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(vocabulary.status().message()), HasSubstr(what));
  };
  expect_refused([](auto& t) { t = {}; }, "end");
  expect_refused([](auto& t) { t.child_counts.push_back(0); }, "end");
  expect_refused([](auto& t) { t.child_counts[2] = 1; }, "one child");
  expect_refused([](auto& t) { t.child_counts = {2, 0, 0, 3}; }, "no parent");
  expect_refused([](auto& t) { t.child_counts[3] = 2; }, "8 centres");
  expect_refused([](auto& t) { t.centers.pop_back(); }, "7 centres");
  expect_refused([](auto& t) { t.centers.clear(); }, "1 nodes");
  expect_refused([](auto& t) { t.weights.push_back(7); }, "7 weights");
  expect_refused([](auto& t) { t.centers.resize(kMaxVocabularyNodes); }, "nodes");
  expect_refused(  // a chain: one of each two children has the next two
      [](auto& t) {
        t.child_counts.assign(1, 2);
        for (size_t level = 0; level < kMaxVocabularyDepth; ++level) {
          t.child_counts.insert(t.child_counts.end(), {2, 0});
        }
        t.child_counts.pop_back();
        t.centers.resize(2 * kMaxVocabularyDepth + 2);
        t.weights.resize(kMaxVocabularyDepth + 2);
      },
      "levels");
}

TEST(TrainVocabulary, GivesEachOfSeparateThingsItsWord) {
  constexpr size_t kPlaces = 64;
  const auto images = DescriptorsOfImages(30, kPlaces, 4);
  const auto vocabulary = TrainVocabulary(images, {.branching = 8, .depth = 2});
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  EXPECT_GT(vocabulary->word_count(), kPlaces * 9 / 10);
  EXPECT_EQ(vocabulary->tables().training_images, 30u);

  // What is seen again, blurred otherwise, is mostly the same word, and few things share one.
  std::mt19937_64 random(4);
  std::vector<Descriptor> places(kPlaces);
  for (Descriptor& place : places) place = RandomDescriptor(random);
  std::vector<int> things_of_word(vocabulary->word_count(), 0);
  int same = 0;
  for (const Descriptor& place : places) {
    const uint32_t word = vocabulary->WordOf(place);
    ++things_of_word[word];
    for (int i = 0; i < 10; ++i) {
      same += vocabulary->WordOf(WithFlippedBits(place, 10, random)) == word;
    }
  }
  EXPECT_GT(same, 10 * static_cast<int>(kPlaces) * 85 / 100);
  EXPECT_GT(
      std::count_if(things_of_word.begin(), things_of_word.end(), [](int n) { return n > 0; }),
      static_cast<int>(kPlaces) * 2 / 3);
}

TEST(TrainVocabulary, WeighsWordsByTheImagesThatShowThem) {
  std::mt19937_64 random(5);
  const Descriptor everywhere = RandomDescriptor(random), rare = RandomDescriptor(random),
                   in_half = RandomDescriptor(random);
  std::vector<std::vector<Descriptor>> images(8, {everywhere, everywhere});
  images[5] = {everywhere, rare, rare, rare};
  for (int i = 0; i < 4; ++i) images[i].push_back(in_half);
  const auto vocabulary = TrainVocabulary(images, {.branching = 3, .depth = 1});
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  const auto weight = [&](const Descriptor& d) {
    return vocabulary->WeightOf(vocabulary->WordOf(d));
  };
  EXPECT_EQ(weight(everywhere), 0);
  EXPECT_NEAR(weight(in_half), std::log(2.0), 1.0 / 4096);
  EXPECT_NEAR(weight(rare), std::log(8.0), 1.0 / 4096);
}

TEST(TrainVocabulary, StopsWhereDescriptorsAreEqual) {
  std::mt19937_64 random(6);
  const Descriptor a = RandomDescriptor(random), b = RandomDescriptor(random),
                   c = WithFlippedBits(b, 3, random);
  const auto vocabulary = TrainVocabulary({{a, b, a}, {a, c}}, {.branching = 2, .depth = 5});
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  EXPECT_EQ(vocabulary->word_count(), 3u);
  EXPECT_EQ(vocabulary->depth(), 2u);
}

TEST(TrainVocabulary, ReportsProgress) {
  std::vector<std::pair<size_t, size_t>> steps;
  const auto vocabulary =
      TrainVocabulary(DescriptorsOfImages(3, 50, 7), {.branching = 3, .depth = 3},
                      [&](size_t done, size_t total) { steps.emplace_back(done, total); });
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  EXPECT_THAT(steps, testing::ElementsAre(std::pair(1, 4), std::pair(2, 4), std::pair(3, 4),
                                          std::pair(4, 4)));
}

TEST(TrainVocabulary, RefusesWhatItCannotTrainWith) {
  const auto images = DescriptorsOfImages(2, 5, 8);
  for (const VocabularyOptions& options : std::vector<VocabularyOptions>{
           {.branching = 1}, {.branching = 256}, {.depth = 0}, {.depth = 17}, {.depth = 6}}) {
    EXPECT_EQ(TrainVocabulary(images, options).status().code(), absl::StatusCode::kInvalidArgument);
  }
  EXPECT_EQ(TrainVocabulary({images[0]}, {}).status().code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(TrainVocabulary({{}, {}}, {}).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(TrainVocabulary({{images[0][0]}, {images[0][0]}}, {}).status().code(),
            absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace carmap
