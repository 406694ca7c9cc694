#include "carmap/feature/test_selection.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>
#include <set>

namespace carmap {
namespace {

/// Half of them near the corner, as BRIEF's, half anywhere in the patch. From whole numbers only.
std::vector<SignatureTest> DrawCandidates(size_t count, uint64_t seed) {
  constexpr int kSide = 2 * kSignatureRadius + 1;
  std::mt19937_64 random(seed);
  const auto anywhere = [&] { return static_cast<int>(random() % kSide) - kSignatureRadius; };
  const auto near = [&] {  // the sum of four draws: close to a Gaussian of deviation 6.4
    while (true) {
      int sum = -22;
      for (int i = 0; i < 4; ++i) sum += static_cast<int>(random() % 12);
      if (std::abs(sum) <= kSignatureRadius) return sum;
    }
  };
  std::set<SignatureTest> candidates;
  while (candidates.size() < count) {
    const bool is_near = random() % 2 == 0;
    std::array<int8_t, 4> at;
    for (int8_t& coordinate : at) coordinate = static_cast<int8_t>(is_near ? near() : anywhere());
    if (std::abs(at[0] - at[2]) + std::abs(at[1] - at[3]) < 3) continue;
    candidates.insert({at[0], at[1], at[2], at[3]});
  }
  return {candidates.begin(), candidates.end()};
}

bool Holds(const SignatureTest& test, const SignaturePatch& patch) {
  const auto pixel = [&](int x, int y) {
    return patch[(y + kSignatureRadius) * (2 * kSignatureRadius + 1) + x + kSignatureRadius];
  };
  return pixel(test.a_x, test.a_y) < pixel(test.b_x, test.b_y);
}

struct Moments {
  double mean = 0, variance = 0;
};

/// Distances of pairs of patches by the tests that were chosen so far.
class Distances {
 public:
  Distances(const std::vector<PatchTriple>& triples, SignaturePatch PatchTriple::*to,
            const std::vector<SignatureTest>& candidates)
      : distances_(triples.size(), 0), differs_(candidates.size()) {
    tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t c) {
      differs_[c].reserve(triples.size());
      for (const PatchTriple& triple : triples) {
        differs_[c].push_back(Holds(candidates[c], triple.corner) !=
                              Holds(candidates[c], triple.*to));
      }
    });
  }

  /// If the candidate were chosen too.
  Moments With(size_t candidate) const {
    const std::vector<uint8_t>& differs = differs_[candidate];
    uint64_t sum = 0, square_sum = 0;
    for (size_t i = 0; i < differs.size(); ++i) {
      const uint32_t distance = distances_[i] + differs[i];
      sum += distance;
      square_sum += distance * distance;
    }
    const auto count = static_cast<double>(differs.size());
    const double mean = static_cast<double>(sum) / count;
    return {mean, static_cast<double>(square_sum) / count - mean * mean};
  }

  void Choose(size_t candidate) {
    for (size_t i = 0; i < distances_.size(); ++i) distances_[i] += differs_[candidate][i];
  }

 private:
  std::vector<uint32_t> distances_;
  std::vector<std::vector<uint8_t>> differs_;
};

}  // namespace

std::vector<SignatureTest> SelectTests(const std::vector<PatchTriple>& triples,
                                       const SelectionOptions& options,
                                       absl::FunctionRef<void(size_t)> progress) {
  const std::vector<SignatureTest> candidates = DrawCandidates(options.candidates, options.seed);
  Distances same(triples, &PatchTriple::same, candidates);
  Distances other(triples, &PatchTriple::other, candidates);
  std::vector<double> separation(candidates.size());
  std::vector<bool> is_chosen(candidates.size(), false);
  std::vector<SignatureTest> chosen;
  while (chosen.size() < options.tests) {
    tbb::parallel_for(size_t{0}, candidates.size(), [&](size_t c) {
      const Moments of_same = same.With(c), of_other = other.With(c);
      // The very first tests vary little or not at all.
      const double spread = std::sqrt(of_same.variance + of_other.variance + 1e-6);
      separation[c] = is_chosen[c] ? -1e9 : (of_other.mean - of_same.mean) / spread;
    });
    const size_t best = std::max_element(separation.begin(), separation.end()) - separation.begin();
    is_chosen[best] = true;
    same.Choose(best);
    other.Choose(best);
    chosen.push_back(candidates[best]);
    progress(chosen.size());
  }
  return chosen;
}

}  // namespace carmap
