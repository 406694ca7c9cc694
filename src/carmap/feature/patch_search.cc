#include "carmap/feature/patch_search.h"

#include <algorithm>
#include <limits>

// What follows is compiled once for each kind of processor; the best of them runs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "carmap/feature/patch_search.cc"
#include <hwy/foreach_target.h>
// After it:
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace carmap::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

/// Compared at once. Those beyond the last one asked for may lie in the image's next row.
constexpr int kMaxPlaces = 32;
using Bytes = hn::CappedTag<uint8_t, kMaxPlaces>;

/// Sums of absolute differences between the patch around `center` and those around `places` and the
/// pixels right of it: a whole vector of them.
void SumDifferences(const uint8_t* center, size_t left_step, const uint8_t* places,
                    size_t right_step, uint16_t* sums) {
  const Bytes bytes;
  const hn::Repartition<uint16_t, Bytes> words;
  // Of two places in a word: the sums of both, carries lost, and that of the upper one alone.
  auto both = hn::Zero(words), upper = hn::Zero(words);
  for (int dy = -kSearchRadius; dy <= kSearchRadius; ++dy) {
    const uint8_t* patch_row = center + dy * static_cast<ptrdiff_t>(left_step);
    const uint8_t* row = places + dy * static_cast<ptrdiff_t>(right_step);
    for (int dx = -kSearchRadius; dx <= kSearchRadius; ++dx) {
      const auto grey = hn::Set(bytes, patch_row[dx]), other = hn::LoadU(bytes, row + dx);
      const auto difference =
          hn::BitCast(words, hn::Sub(hn::Max(grey, other), hn::Min(grey, other)));
      both = hn::Add(both, difference);
      upper = hn::Add(upper, hn::ShiftRight<8>(difference));
    }
  }
  hn::StoreInterleaved2(hn::Sub(both, hn::ShiftLeft<8>(upper)), upper, words, sums);
}

void SumDifferencesAlongRow(const cv::Mat& left, int x, int y, const cv::Mat& right, int x_first,
                            size_t count, std::vector<uint16_t>& sums) {
  const size_t lanes = hn::Lanes(Bytes());
  sums.resize((count + lanes - 1) / lanes * lanes);
  for (size_t i = 0; i < count; i += lanes) {
    SumDifferences(left.ptr<uint8_t>(y, x), left.step[0],
                   right.ptr<uint8_t>(y, x_first + static_cast<int>(i)), right.step[0],
                   sums.data() + i);
  }
  sums.resize(count);
}

uint16_t Least(const std::vector<uint16_t>& sums) {
  uint16_t least = std::numeric_limits<uint16_t>::max();
  for (const uint16_t sum : sums) least = std::min(least, sum);
  return least;
}

std::optional<int> FindAlongRow(const cv::Mat& left, int x, int y, const cv::Mat& right,
                                int x_first, int x_last, const PatchSearchOptions& options,
                                std::vector<uint16_t>& sums) {
  if (right.cols < kMaxPlaces) return std::nullopt;
  SumDifferencesAlongRow(left, x, y, right, x_first, x_last - x_first + 1, sums);
  constexpr int kSide = 2 * kSearchRadius + 1, kNeighbours = 2;
  const int least = Least(sums);
  if (least > options.max_mean_difference * kSide * kSide) return std::nullopt;
  const auto best = std::find(sums.begin(), sums.end(), least);
  std::fill(best - std::min<ptrdiff_t>(best - sums.begin(), kNeighbours),
            best + std::min<ptrdiff_t>(sums.end() - best, kNeighbours + 1),
            std::numeric_limits<uint16_t>::max());
  if (Least(sums) <= options.uniqueness * least) return std::nullopt;
  return x_first + static_cast<int>(best - sums.begin());
}

}  // namespace
}  // namespace carmap::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace carmap {

HWY_EXPORT(FindAlongRow);

std::optional<int> FindAlongRow(const cv::Mat& left, int x, int y, const cv::Mat& right,
                                int x_first, int x_last, const PatchSearchOptions& options,
                                std::vector<uint16_t>& scratch) {
  return HWY_DYNAMIC_DISPATCH(FindAlongRow)(left, x, y, right, x_first, x_last, options, scratch);
}

}  // namespace carmap
#endif  // HWY_ONCE
