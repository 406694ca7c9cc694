#include "carmap/index/word_index.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>

#include "carmap/feature/test_descriptors.h"
#include "carmap/feature/vocabulary_trainer.h"

namespace carmap {

bool operator==(const SimilarKeyframe& a, const SimilarKeyframe& b) {
  return a.id == b.id && a.similarity == b.similarity;
}

namespace {

using ::testing::ElementsAreArray;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr size_t kWords = 500;

KeyframeId Id(uint32_t index) { return {{7}, index}; }

/// Of some of the words, without a vocabulary.
WordHistogram RandomHistogram(std::mt19937_64& random) {
  WordHistogram histogram;
  for (uint32_t word = 0; word < kWords; ++word) {
    if (random() % 8 != 0) continue;
    histogram.push_back({word, static_cast<float>(1 + random() % 100) / 3200});
  }
  return histogram;
}

/// What an index must answer, by comparing with each keyframe.
std::vector<SimilarKeyframe> CompareWithAll(const std::map<KeyframeId, WordHistogram>& keyframes,
                                            const WordHistogram& histogram,
                                            const PlaceQuery& query) {
  std::vector<SimilarKeyframe> found;
  for (const auto& [id, of_keyframe] : keyframes) {
    const float similarity = Similarity(histogram, of_keyframe);
    if (similarity <= query.min_similarity) continue;
    if (std::count(query.excluded.begin(), query.excluded.end(), id) > 0) continue;
    found.push_back({id, similarity});
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.similarity > b.similarity; });
  if (found.size() > query.max_count) found.resize(query.max_count);
  return found;
}

/// Words 0, 1, 2 with weights 2, 1 and 0.
Vocabulary ThreeWords() {
  std::mt19937_64 random(1);
  const std::vector<Descriptor> centers = {RandomDescriptor(random), RandomDescriptor(random),
                                           RandomDescriptor(random)};
  return Vocabulary::Create({8, {3}, centers, {2 * 4096, 4096, 0}}).value();
}

TEST(HistogramOf, WeighsAndNormalizesWords) {
  const Vocabulary vocabulary = ThreeWords();
  const WordHistogram histogram = HistogramOf(vocabulary, {1, 0, 2, 1, 1, 2, 0});
  EXPECT_THAT(histogram, ElementsAreArray<WordWeight>({{0, 4.0f / 7}, {1, 3.0f / 7}}));
  EXPECT_THAT(HistogramOf(vocabulary, {2, 2}), IsEmpty()) << "they weigh nothing";
  EXPECT_THAT(HistogramOf(vocabulary, std::vector<uint32_t>()), IsEmpty());
}

TEST(HistogramOf, TakesTheWordsOfFeatures) {
  const Vocabulary vocabulary = ThreeWords();
  const auto& centers = vocabulary.tables().centers;
  std::vector<Feature> features(3);
  for (size_t i = 0; i < 3; ++i) features[i].descriptor = centers[i % 2];
  EXPECT_EQ(HistogramOf(vocabulary, features), HistogramOf(vocabulary, {0, 0, 1}));
}

TEST(Similarity, IsOneOfEqualZeroOfDisjointAndSymmetric) {
  std::mt19937_64 random(2);
  const Vocabulary vocabulary =
      TrainVocabulary(DescriptorsOfImages(20, 200, 3), {.branching = 10, .depth = 2}).value();
  std::vector<WordHistogram> histograms;
  for (const auto& image : DescriptorsOfImages(10, 300, 4)) {
    std::vector<uint32_t> words;
    for (const Descriptor& descriptor : image) words.push_back(vocabulary.WordOf(descriptor));
    histograms.push_back(HistogramOf(vocabulary, words));
  }
  for (const WordHistogram& a : histograms) {
    EXPECT_NEAR(Similarity(a, a), 1, 1e-5);
    EXPECT_EQ(Similarity(a, {}), 0);
    for (const WordHistogram& b : histograms) {
      EXPECT_FLOAT_EQ(Similarity(a, b), Similarity(b, a));
      double difference = 0;
      for (uint32_t word = 0; word < vocabulary.word_count(); ++word) {
        const auto weight = [&](const WordHistogram& histogram) {
          for (const WordWeight& w : histogram) {
            if (w.word_idx == word) return w.weight;
          }
          return 0.0f;
        };
        difference += std::abs(weight(a) - weight(b));
      }
      EXPECT_NEAR(Similarity(a, b), 1 - difference / 2, 1e-5);
    }
  }
  EXPECT_EQ(Similarity({{0, 0.5f}, {2, 0.5f}}, {{1, 0.25f}, {3, 0.75f}}), 0);
}

TEST(WordIndex, AnswersAsIfEachKeyframeWereCompared) {
  std::mt19937_64 random(5);
  WordIndex index(kWords);
  std::map<KeyframeId, WordHistogram> keyframes;
  for (int step = 0; step < 400; ++step) {
    const KeyframeId id = Id(random() % 80);
    if (random() % 3 == 0) {
      EXPECT_EQ(index.Remove(id), keyframes.erase(id) == 1);
    } else {
      keyframes[id] = RandomHistogram(random);
      index.Add(id, keyframes[id]);
    }
    ASSERT_EQ(index.size(), keyframes.size());
    if (step % 5 != 0) continue;
    std::vector<KeyframeId> excluded;
    for (uint32_t i = random() % 20; i < 80; i += 1 + random() % 10) excluded.push_back(Id(i));
    const PlaceQuery query{excluded, static_cast<float>(random() % 10) / 40, 1 + random() % 30};
    const WordHistogram histogram = RandomHistogram(random);
    ASSERT_THAT(index.FindSimilar(histogram, query),
                ElementsAreArray(CompareWithAll(keyframes, histogram, query)));
  }
}

TEST(WordIndex, FindsNothingWhereNothingIsShared) {
  WordIndex index(kWords);
  EXPECT_THAT(index.FindSimilar({{1, 1.0f}}), IsEmpty());
  index.Add(Id(1), {{1, 0.5f}, {2, 0.5f}});
  index.Add(Id(2), {});
  EXPECT_EQ(index.size(), 2u);
  EXPECT_THAT(index.FindSimilar({{3, 1.0f}}), IsEmpty());
  EXPECT_THAT(index.FindSimilar({}), IsEmpty());
  EXPECT_THAT(index.FindSimilar({{2, 1.0f}}), SizeIs(1));
  EXPECT_TRUE(index.Remove(Id(1)));
  EXPECT_FALSE(index.Remove(Id(1)));
  EXPECT_THAT(index.FindSimilar({{2, 1.0f}}), IsEmpty());
}

TEST(WordIndex, EquallySimilarOnesComeById) {
  WordIndex index(kWords);
  const WordHistogram histogram = {{4, 1.0f}};
  for (const uint32_t i : {5u, 3u, 9u, 1u}) index.Add(Id(i), histogram);
  const auto found = index.FindSimilar(histogram, {.max_count = 3});
  EXPECT_THAT(found, ElementsAreArray<SimilarKeyframe>({{Id(1), 1}, {Id(3), 1}, {Id(5), 1}}));
}

TEST(WordIndex, ReadsTheRarestWordsWhenItMayNotReadAll) {
  WordIndex index(kWords);
  for (uint32_t i = 0; i < 10; ++i) index.Add(Id(i), {{1, 0.5f}, {2 + i % 2, 0.5f}});
  const WordHistogram histogram = {{1, 0.6f}, {2, 0.4f}};
  EXPECT_THAT(index.FindSimilar(histogram, {.max_postings = 15}), SizeIs(10));
  const auto found = index.FindSimilar(histogram, {.max_postings = 14});
  EXPECT_THAT(found,
              ElementsAreArray<SimilarKeyframe>(
                  {{Id(0), 0.4f}, {Id(2), 0.4f}, {Id(4), 0.4f}, {Id(6), 0.4f}, {Id(8), 0.4f}}));
  EXPECT_THAT(index.FindSimilar(histogram, {.max_postings = 4}), IsEmpty());
}

TEST(WordIndex, ForgetsWhatWasRemoved) {
  // A keyframe that comes and goes leaves nothing behind.
  std::mt19937_64 random(6);
  WordIndex index(kWords);
  for (uint32_t i = 0; i < 10; ++i) index.Add(Id(i), RandomHistogram(random));
  const size_t before = index.posting_count();
  for (uint32_t i = 0; i < 1000; ++i) {
    index.Add(Id(10 + i), RandomHistogram(random));
    index.Remove(Id(10 + i));
  }
  EXPECT_LT(index.posting_count(), 4 * before);
}

}  // namespace
}  // namespace carmap
