#include "carmap/feature/test_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace carmap {
namespace {

constexpr int kSide = 2 * kSignatureRadius + 1;

SignaturePatch RandomPatch(std::mt19937_64& random) {
  SignaturePatch patch;
  for (uint8_t& pixel : patch) pixel = static_cast<uint8_t>(random() % 256);
  return patch;
}

/// The right half of another day's patch is new, as where a parked car stood.
std::vector<PatchTriple> TriplesThatKeepTheirLeftHalf() {
  std::mt19937_64 random(5);
  std::vector<PatchTriple> triples;
  for (int i = 0; i < 400; ++i) {
    PatchTriple triple{RandomPatch(random), RandomPatch(random), RandomPatch(random)};
    for (int p = 0; p < kSide * kSide; ++p) {
      if (p % kSide < kSide / 2) triple.same[p] = triple.corner[p];
    }
    triples.push_back(triple);
  }
  return triples;
}

TEST(SelectTestsTest, TakesThoseThatHold) {
  size_t last = 0;
  const auto tests = SelectTests(TriplesThatKeepTheirLeftHalf(), {.candidates = 400, .tests = 40},
                                 [&](size_t chosen) { EXPECT_EQ(chosen, ++last); });
  ASSERT_EQ(tests.size(), 40u);
  EXPECT_TRUE(std::all_of(tests.begin(), tests.end(),
                          [](const SignatureTest& test) { return test.a_x < 0 && test.b_x < 0; }));
  auto distinct = tests;
  std::sort(distinct.begin(), distinct.end());
  EXPECT_EQ(std::unique(distinct.begin(), distinct.end()), distinct.end());
}

TEST(SelectTestsTest, GivesTheSameForTheSameSeed) {
  const auto triples = TriplesThatKeepTheirLeftHalf();
  const auto select = [&](uint64_t seed) {
    return SelectTests(triples, {.candidates = 100, .tests = 8, .seed = seed}, [](size_t) {});
  };
  EXPECT_EQ(select(1), select(1));
  EXPECT_NE(select(1), select(2));
}

TEST(SignatureTestsTest, StayInThePatchAndDiffer) {
  auto tests = kSignatureTests;
  for (const SignatureTest& test : tests) {
    for (const int at : {test.a_x, test.a_y, test.b_x, test.b_y}) {
      EXPECT_LE(std::abs(at), kSignatureRadius);
    }
  }
  std::sort(tests.begin(), tests.end());
  EXPECT_EQ(std::unique(tests.begin(), tests.end()), tests.end());
}

}  // namespace
}  // namespace carmap
